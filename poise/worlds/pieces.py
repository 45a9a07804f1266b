"""A solid cut into convex pieces, as physics engines want it."""

import numpy as np
from scipy.spatial import ConvexHull

from poise.assembly.contact import bounds_of, winding_number
from poise.assembly.scene import Polyhedron
from poise.errors import ErrorCode, InputError
from poise.types import Array

_MOST_PIECES = 60
_THIN = 1e-7
"""Relative to the size of the solid: facets that reach less into a cell do not cut it."""


def convex_pieces(polyhedron: Polyhedron) -> list[Array]:
    """Corners (N, 3) of convex pieces that fill a solid exactly.

    Its hull is cut, again and again, along a facet that runs through the inside of a cell; what no facet runs through
    is wholly inside or outside.

    Raises:
        InputError: UNSUPPORTED for a solid, such as a round bowl, that takes too many pieces.
    """
    if polyhedron.convex:
        return [polyhedron.vertices]
    size = float(np.ptp(polyhedron.vertices, axis=0).max())
    corners = polyhedron.vertices[polyhedron.triangles]
    bounds = bounds_of(corners)
    hull = ConvexHull(polyhedron.vertices)
    open_cells, pieces = [polyhedron.vertices[hull.vertices]], []
    while open_cells:
        cell = open_cells.pop()
        facet = _facet_through(polyhedron, cell, _THIN * size)
        if facet is None:
            middle = cell.mean(axis=0)
            if winding_number(middle[None], corners, bounds)[0] > 0:
                pieces.append(cell)
        else:
            normal = polyhedron.normals[facet]
            point = polyhedron.vertices[polyhedron.facet_triangles[facet][0, 0]]
            open_cells += [_clipped(cell, sign * normal, point, _THIN * size) for sign in (1.0, -1.0)]
        if len(pieces) + len(open_cells) > _MOST_PIECES:
            raise InputError(ErrorCode.UNSUPPORTED, f"the solid takes more than {_MOST_PIECES} convex pieces")
    return pieces


def _facet_through(polyhedron: Polyhedron, cell: Array, thin: float) -> int | None:
    """A facet with area inside a convex cell; the one whose plane cuts the fewest others is not looked for."""
    planes = ConvexHull(cell).equations
    for facet, triangles in enumerate(polyhedron.facet_triangles):
        heights = (cell - polyhedron.vertices[triangles[0, 0]]) @ polyhedron.normals[facet]
        if heights.min() > -thin or heights.max() < thin:
            continue
        if any(_area_inside(polyhedron.vertices[triangle], planes, thin) > thin**2 for triangle in triangles):
            return facet
    return None


def _area_inside(polygon: Array, planes: Array, thin: float) -> float:
    """m2 of a planar convex polygon (K, 3) inside planes (P, 4), each moved inwards a little (Sutherland, Hodgman)."""
    for *normal, offset in planes.tolist():
        polygon = _below(polygon, polygon @ np.array(normal) + offset + thin)
        if len(polygon) < 3:
            return 0.0
    fan = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0])
    return float(np.linalg.norm(fan.sum(axis=0)) / 2)


def _below(polygon: Array, heights: Array) -> Array:
    """The part of a convex polygon (K, 3) whose corners' heights are not positive."""
    kept = []
    for a, b, high_a, high_b in zip(polygon, np.roll(polygon, -1, axis=0), heights, np.roll(heights, -1), strict=True):
        if high_a <= 0:
            kept.append(a)
        if high_a * high_b < 0:
            kept.append(a + (b - a) * high_a / (high_a - high_b))
    return np.array(kept).reshape(-1, 3)


def _clipped(cell: Array, normal: Array, point: Array, thin: float) -> Array:
    """The corners of the part of a convex cell below a plane."""
    hull = ConvexHull(cell)
    heights = (cell - point) @ normal
    edges = np.unique(np.sort(hull.simplices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    a, b = heights[edges[:, 0]], heights[edges[:, 1]]
    cut = a * b < 0
    share = (a[cut] / (a[cut] - b[cut]))[:, None]
    crossing = cell[edges[cut, 0]] + share * (cell[edges[cut, 1]] - cell[edges[cut, 0]])
    corners = np.concatenate([cell[heights <= thin], crossing])
    return np.asarray(corners[ConvexHull(corners).vertices])
