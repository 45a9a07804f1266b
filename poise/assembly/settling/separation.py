"""Planes that keep bodies apart which do not rest flat on each other."""

import numpy as np

from poise.assembly.scene import RigidObject
from poise.assembly.settling.rows import DistanceRows
from poise.geometry import Pose
from poise.types import Array, Indices, Mask

_CORNERS = 4
"""Corners of a body that are kept over a plane of its neighbour."""


def keep_apart(
    items: tuple[RigidObject, ...], poses: Pose, free: Mask, reach: float, touching: set[tuple[int, int]]
) -> DistanceRows:
    """For pairs of convex bodies that are near: the corners of one over the face of the other that parts them best.

    SeenBodies that are not convex have no such face; `find_interfaces` checks them at the end.

    Args:
        items: N objects.
        poses: of them.
        free: (N,) whether each may move.
        reach: m; pairs farther apart are left out.
        touching: pairs of places that contacts keep apart.
    """
    corners, normals, offsets = [], [], []
    for item, rotation, translation in zip(items, poses.rotation, poses.translation, strict=True):
        shape = item.shape.polyhedron
        corners.append(shape.vertices @ rotation.T + translation)
        first = [triangles[0, 0] for triangles in shape.facet_triangles] if shape.convex else []
        normals.append(shape.normals[: len(first)] @ rotation.T)
        offsets.append(np.einsum("fi,fi->f", normals[-1], corners[-1][first]))
    low = np.array([points.min(axis=0) for points in corners])
    high = np.array([points.max(axis=0) for points in corners])
    near = np.all(low[:, None] <= high[None] + reach, axis=2)
    near &= near.T & (free[:, None] | free[None])
    parted: list[tuple[int, int, int, Indices]] = []
    for i, j in np.argwhere(np.triu(near, 1)).tolist():
        if (i, j) in touching or not len(normals[i]) or not len(normals[j]):
            continue
        best = max((_best(normals[a], offsets[a], corners[b]), a, b) for a, b in ((i, j), (j, i)))
        (distance, facet), base, other = best
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
    counts, shapes = [len(lowest) for *_, lowest in parted], [item.shape.polyhedron for item in items]
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
