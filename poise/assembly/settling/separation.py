"""Planes that keep bodies apart which do not rest flat on each other."""

import numpy as np

from poise.assembly.scene import RigidObject, hull_of
from poise.assembly.settling.rows import DistanceRows
from poise.geometry import Pose
from poise.types import Array, Indices, Mask

_CORNERS = 4
"""Corners of a body that are kept over a plane of its neighbour."""
_BESIDE, _OFF = 0.3, 0.01
"""Of what is not convex, hulls are kept apart beside each other: cosines to the vertical up to which a face is upright,
and m by which they may overlap there. Cups in cups and what lies in a bowl overlap by more, or upwards."""


def keep_apart(
    items: tuple[RigidObject, ...], poses: Pose, free: Mask, reach: float, touching: set[tuple[int, int]], up: Array
) -> DistanceRows:
    """For pairs of bodies that are near: the corners of one over the face of the other that parts them best.

    Bodies that are not convex may have no such face; `find_interfaces` checks them at the end.

    Args:
        items: N objects.
        poses: of them.
        free: (N,) whether each may move.
        reach: m; pairs farther apart are left out.
        touching: pairs of places that contacts keep apart.
        up: (3,) against gravity.
    """
    corners, normals, offsets = [], [], []
    for item, rotation, translation in zip(items, poses.rotation, poses.translation, strict=True):
        shape = hull_of(item.shape.polyhedron)
        corners.append(shape.vertices @ rotation.T + translation)
        first = [triangles[0, 0] for triangles in shape.facet_triangles]
        normals.append(shape.normals @ rotation.T)
        offsets.append(np.einsum("fi,fi->f", normals[-1], corners[-1][first]))
    low = np.array([points.min(axis=0) for points in corners])
    high = np.array([points.max(axis=0) for points in corners])
    near = np.all(low[:, None] <= high[None] + reach, axis=2)
    near &= near.T & (free[:, None] | free[None])
    parted: list[tuple[int, int, int, Indices]] = []
    for i, j in np.argwhere(np.triu(near, 1)).tolist():
        if (i, j) in touching:
            continue
        best = max((_best(normals[a], offsets[a], corners[b]), a, b) for a, b in ((i, j), (j, i)))
        (distance, facet), base, other = best
        convex = items[i].shape.polyhedron.convex and items[j].shape.polyhedron.convex
        if not convex and (distance < -_OFF or abs(float(normals[base][facet] @ up)) > _BESIDE):
            continue
        if distance <= reach:
            lowest = np.argsort(corners[other] @ normals[base][facet], kind="stable")[:_CORNERS]
            parted.append((base, facet, other, lowest))
    return _rows(items, parted)


def _best(normals: Array, offsets: Array, corners: Array) -> tuple[float, int]:
    """The largest distance, m, by which all corners are over one of the planes, and its number."""
    distances = (normals @ corners.T).min(axis=1) - offsets
    facet = int(distances.argmax())
    return float(distances[facet]), facet


def _rows(items: tuple[RigidObject, ...], parted: list[tuple[int, int, int, Indices]]) -> DistanceRows:
    """The lowest corners of other bodies over a facet of a base, for (base, facet, other, corners) each."""
    if not parted:
        return DistanceRows.joined([])
    counts, shapes = [len(lowest) for *_, lowest in parted], [hull_of(item.shape.polyhedron) for item in items]
    normals = [shapes[base].normals[facet] for base, facet, *_ in parted]
    origins = [shapes[base].vertices[shapes[base].facet_triangles[facet][0, 0]] for base, facet, *_ in parted]
    return DistanceRows(
        np.repeat([base for base, *_ in parted], counts),
        np.repeat([other for _, _, other, _ in parted], counts),
        np.repeat(normals, counts, axis=0),
        np.repeat(origins, counts, axis=0),
        np.concatenate([shapes[other].vertices[lowest] for _, _, other, lowest in parted]),
        np.zeros(sum(counts)),
    )
