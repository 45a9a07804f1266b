"""The flat faces of shapes, as outlines in their planes, and where faces of two bodies lie opposite each other."""

from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, cast

import numpy as np
import shapely
from numpy.typing import NDArray

from poise.assembly.contact import triangle_areas
from poise.assembly.scene import Cylinder, Polyhedron, Shape
from poise.geometry import Pose, plane_axes
from poise.types import Array, Indices, Mask

_LEAST_SHARE = 0.01
"""Of a surface: smaller faces are taken as parts of a curved one."""
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
    """

    normals: Array
    origins: Array
    axes: Array
    outlines: Outlines


@lru_cache(maxsize=512)
def facets_of(shape: Hashable) -> Facets:
    """The large flat faces of a shape; the caps of a cylinder."""
    polyhedron = cast(Shape, shape).polyhedron
    areas = triangle_areas(polyhedron.vertices[polyhedron.triangles])
    share = np.bincount(polyhedron.facet_of_triangle, areas, len(polyhedron.normals)) / areas.sum()
    chosen = np.arange(2) if isinstance(shape, Cylinder) else np.flatnonzero(share >= _LEAST_SHARE)
    origins = np.array([polyhedron.vertices[polyhedron.facet_triangles[f][0, 0]] for f in chosen]).reshape(-1, 3)
    normals = polyhedron.normals[chosen]
    axes = plane_axes(normals) if len(chosen) else np.zeros((0, 2, 3))
    outlines = [_outline(polyhedron, int(f), o, a) for f, o, a in zip(chosen, origins, axes, strict=True)]
    return Facets(normals, origins, axes, np.array(outlines, dtype=object))


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
        width: (C,) m, of the region: twice its area over half its outline; at least half its shorter side.
        area: (C,) m2 of it.
    """

    first: Indices
    second: Indices
    facets: Indices
    points: Array
    width: Array
    area: Array


def opposite_faces(shapes: list[Shape], poses: Pose, reach: Array, angle: Array, wanted: Mask) -> Opposite:
    """Pairs of faces that may lie flat on each other.

    Args:
        shapes: N.
        poses: of them.
        reach: (N,) m by which each may be off, its corners included.
        angle: (N,) rad by which it may be turned.
        wanted: (N,) whether it may move; pairs of two that may not are left out.
    """
    facets = [facets_of(cast(Hashable, shape)) for shape in shapes]
    body = np.repeat(np.arange(len(shapes)), [len(f.normals) for f in facets])
    number = np.concatenate([np.arange(len(f.normals)) for f in facets])
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
    area, outline = shapely.area(region), shapely.length(region)
    kept = np.flatnonzero(area > 0)
    middle = shapely.get_coordinates(shapely.centroid(region[kept]))
    box = shapely.bounds(region[kept])
    half = (box[:, 2:] - box[:, :2]) / 2
    around = middle[:, None] + half[:, None] * np.array([[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]])
    a, b = a[kept], b[kept]
    points = origins[a][:, None] + np.einsum("cpk,cki->cpi", around, axes[a])
    over = np.einsum("cpi,ci->cp", points - origins[b][:, None], normals[b])
    points = points - over[..., None] * normals[b][:, None]
    both = np.stack([number[a], number[b]], axis=1)
    return Opposite(body[a], body[b], both, points, 4 * area[kept] / outline[kept], area[kept])


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
