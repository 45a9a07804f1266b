"""The flat faces of shapes, as outlines in their planes, and where faces of two bodies lie opposite each other."""

from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, cast

import numpy as np
import shapely
from numpy.typing import NDArray

from poise.assembly.scene import Cylinder, Polyhedron, Shape, Sphere
from poise.geometry import Pose, plane_axes
from poise.types import Array, Indices, Mask

_LEAST_SHARE = 0.01
"""Of a surface: smaller faces are taken as parts of a curved one."""
_OPPOSITE = -0.999
_SAME_SIZE = 1e-3
"""m by which bodies that are aligned may differ in size."""
_TOUCHING_SOON = 2e-3
"""m added to what poses may be off."""

Outlines = NDArray[Any]
"""Of shapely polygons."""


@dataclass(frozen=True, eq=False)
class Facets:
    """The large flat faces of a shape, in the object frame.

    Args:
        normals: (F, 3) outward.
        origins: (F, 3) a point on each.
        axes: (F, 2, 3) in the plane of each.
        outlines: (F,) polygons in these axes, from these origins.
        around: (F, 3, 3) three points of the rectangle around each outline, as in `Opposite`.
        depth: (F,) m, how far the body reaches behind each.
        leads: (F,) whether no earlier face looks the opposite way.
    """

    normals: Array
    origins: Array
    axes: Array
    outlines: Outlines
    around: Array
    depth: Array
    leads: Mask


@lru_cache(maxsize=512)
def facets_of(shape: Hashable) -> Facets:
    """The large flat faces of a shape; the caps of a cylinder; none of a ball."""
    polyhedron = cast(Shape, shape).polyhedron
    share = polyhedron.facet_areas / polyhedron.facet_areas.sum()
    chosen = np.arange(2) if isinstance(shape, Cylinder) else np.flatnonzero(share >= _LEAST_SHARE)
    chosen = chosen[:0] if isinstance(shape, Sphere) else chosen
    origins = np.array([polyhedron.vertices[polyhedron.facet_triangles[f][0, 0]] for f in chosen]).reshape(-1, 3)
    normals = polyhedron.normals[chosen]
    axes = plane_axes(normals) if len(chosen) else np.zeros((0, 2, 3))
    outlines = [_outline(polyhedron, int(f), o, a) for f, o, a in zip(chosen, origins, axes, strict=True)]
    box = shapely.bounds(outlines).reshape(-1, 4)
    around = origins[:, None] + np.einsum("fpk,fki->fpi", _three_points(box), axes)
    depth = np.ptp(normals @ polyhedron.vertices.T, axis=1)
    leads = ~np.any(np.tril(normals @ normals.T < _OPPOSITE, -1), axis=1)
    return Facets(normals, origins, axes, np.array(outlines, dtype=object), around, depth, leads)


def _three_points(box: Array) -> Array:
    """(C, 3, 2) corners at one side of rectangles (C, 4: least x, y, greatest x, y), and the middle of the other."""
    half = (box[:, 2:] - box[:, :2]) / 2
    across = np.array([[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]])
    return np.asarray(((box[:, :2] + box[:, 2:]) / 2)[:, None] + half[:, None] * across)


def _outline(polyhedron: Polyhedron, facet: int, origin: Array, axes: Array) -> shapely.Geometry:
    if not polyhedron.convex:
        return polyhedron.polygon(facet, polyhedron.vertices, origin, axes)
    corners = (polyhedron.vertices[polyhedron.facet_vertices[facet]] - origin) @ axes.T
    return shapely.MultiPoint(corners).convex_hull


@dataclass(frozen=True, eq=False)
class Opposite:
    """Faces that lie opposite each other: C pairs, each way round once.

    Args:
        first, second: (C,) places of the bodies.
        facets: (C, 2) numbers in their `Facets`.
        points: (C, 3, 3) three points around the region that both faces cover, on the second face, in the assembly's
            frame.
        width: (C,) m, the shorter side of the rectangle around the region, along the axes of the first face.
    """

    first: Indices
    second: Indices
    facets: Indices
    points: Array
    width: Array


def opposite_faces(shapes: list[Shape], poses: Pose, reach: Array, angle: Array, wanted: Mask) -> Opposite:
    """Pairs of faces that may lie flat on each other.

    Args:
        shapes: N.
        poses: of them.
        reach: (N,) m by which each may be off, its corners included.
        angle: (N,) rad by which it may be turned.
        wanted: (N,) whether it may move; pairs of two that may not are left out.
    """
    facets, body, number = _every(shapes)
    turn = poses.rotation[body]
    normals = np.einsum("fij,fj->fi", turn, np.concatenate([f.normals for f in facets]))
    origins = np.einsum("fij,fj->fi", turn, np.concatenate([f.origins for f in facets])) + poses.translation[body]
    axes = np.einsum("fij,fkj->fki", turn, np.concatenate([f.axes for f in facets]))
    outlines = np.concatenate([f.outlines for f in facets])
    low, high = _bounds(outlines, origins, axes)
    away = reach[body][:, None] + reach[body][None] + _TOUCHING_SOON
    near = normals @ normals.T < -np.cos(np.minimum(angle[body][:, None] + angle[body][None], 0.5))
    for axis in range(3):
        near &= low[:, None, axis] <= high[None, :, axis] + away
        near &= low[None, :, axis] <= high[:, None, axis] + away
    near &= (body[:, None] < body[None]) & (wanted[body][:, None] | wanted[body][None])
    a, b = np.nonzero(near)
    # Both outlines, drawn in the plane of the first.
    drawn_a = outlines[a]
    slide = np.einsum("cki,ci->ck", axes[a], origins[b] - origins[a])
    drawn_b = _mapped(outlines[b], np.einsum("cki,cli->ckl", axes[b], axes[a]), slide)
    region = shapely.intersection(drawn_a, drawn_b)
    kept = np.flatnonzero(shapely.area(region) > 0)
    box = shapely.bounds(region[kept])
    a, b = a[kept], b[kept]
    points = origins[a][:, None] + np.einsum("cpk,cki->cpi", _three_points(box), axes[a])
    over = np.einsum("cpi,ci->cp", points - origins[b][:, None], normals[b])
    points = points - over[..., None] * normals[b][:, None]
    both = np.stack([number[a], number[b]], axis=1)
    return Opposite(body[a], body[b], both, points, (box[:, 2:] - box[:, :2]).min(axis=1))


def faces_in_line(shapes: list[Shape], poses: Pose, pairs: Mask, angle: Array) -> tuple[Indices, Indices, Indices]:
    """Faces of two bodies that look the same way, where both are equally deep: their other sides are in line, too.

    Args:
        shapes: N.
        poses: of them.
        pairs: (N, N) whether the first and the second body are asked about.
        angle: (N,) rad by which each may be turned.

    Returns:
        (C,) places of the first and of the second bodies, and (C, 2) numbers in their `Facets`.
    """
    facets, body, number = _every(shapes)
    normals = np.einsum("fij,fj->fi", poses.rotation[body], np.concatenate([f.normals for f in facets]))
    depth, leads = np.concatenate([f.depth for f in facets]), np.concatenate([f.leads for f in facets])
    close = normals @ normals.T > np.cos(np.minimum(angle[body][:, None] + angle[body][None], 0.5))
    close &= (np.abs(depth[:, None] - depth[None]) <= _SAME_SIZE) & leads[:, None] & pairs[body[:, None], body[None]]
    a, b = np.nonzero(close)
    return body[a], body[b], np.stack([number[a], number[b]], axis=1)


def _every(shapes: list[Shape]) -> tuple[list[Facets], Indices, Indices]:
    """The faces of all shapes, and of each the place of its body and its number there."""
    facets = [facets_of(cast(Hashable, shape)) for shape in shapes]
    body = np.repeat(np.arange(len(shapes)), [len(f.normals) for f in facets])
    return facets, body, np.concatenate([np.arange(len(f.normals)) for f in facets])


def _mapped(outlines: Outlines, turn: Array, slide: Array) -> Outlines:
    """(C,) outlines with the coordinates x @ turn + slide."""
    coordinates, which = shapely.get_coordinates(outlines, return_index=True)
    moved = np.einsum("xk,xkl->xl", coordinates, turn[which]) + slide[which]
    return np.asarray(shapely.set_coordinates(outlines.copy(), moved))


def _bounds(outlines: Outlines, origins: Array, axes: Array) -> tuple[Array, Array]:
    """(F, 3) least and greatest coordinates of faces."""
    coordinates, which = shapely.get_coordinates(outlines, return_index=True)
    corners = origins[which] + np.einsum("xk,xki->xi", coordinates, axes[which])
    starts = np.searchsorted(which, np.arange(len(outlines)))
    return np.minimum.reduceat(corners, starts), np.maximum.reduceat(corners, starts)
