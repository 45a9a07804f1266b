"""Outlines seen from above: of what bodies have between two heights, and where two outlines meet."""

import numpy as np
import shapely
from numpy.typing import NDArray

from poise.assembly.scene import Polyhedron
from poise.types import Array, Indices

_COARSE = 2e-4
"""m, by which an outline of a body with hollows may be simplified."""
_SHORT = 1e-9
"""m."""


def convex_outline(points: Array) -> Array:
    """(K, 2) corners of the convex hull of points (N, 2), counter-clockwise; two or one where it has no area."""
    hull = shapely.convex_hull(shapely.multipoints(points))
    if hull.geom_type == "Polygon":
        return np.asarray(shapely.get_coordinates(shapely.orient_polygons(hull))[:-1])
    return np.asarray(shapely.get_coordinates(hull))


def meeting_region(fixed: Array, moving: Array) -> Array:
    """(K, 2) outline of the places of a convex outline (M, 2) at which it meets another (N, 2).

    The Minkowski sum of the other and of the mirrored outline (Lozano-Perez 1983): the edges of both, by angle.

    Args:
        fixed: corners, counter-clockwise.
        moving: corners about the point whose place is asked for, counter-clockwise.
    """
    if len(fixed) < 3 or len(moving) < 3:
        return convex_outline((fixed[:, None] - moving).reshape(-1, 2))
    polygons = [np.roll(p, -int(np.lexsort((p[:, 0], p[:, 1]))[0]), axis=0) for p in (fixed, -moving)]
    edges = np.concatenate([np.roll(p, -1, axis=0) - p for p in polygons])
    angles = np.arctan2(edges[:, 1], edges[:, 0]) % (2 * np.pi)
    steps = np.cumsum(edges[np.argsort(angles, kind="stable")], axis=0)
    return np.asarray(polygons[0][0] + polygons[1][0] + np.concatenate([np.zeros((1, 2)), steps[:-1]]))


def parts_between(polyhedron: Polyhedron, corners: Array, low: float, high: float) -> list[Array]:
    """Convex outlines (K, 2) that together cover what a body has between two heights.

    Args:
        polyhedron: of the body.
        corners: (V, 3) m, its vertices: two level coordinates and the height.
        low, high: m.
    """
    if polyhedron.convex:
        hull = _clipped_ends(corners, polyhedron.edges, low, high)
        return [convex_outline(hull[:, :2])] if len(hull) else []
    shapes = _clipped_triangles(corners[polyhedron.triangles], low, high)
    if not len(shapes):
        return []
    whole = shapely.union_all(shapes).simplify(_COARSE)
    found = []
    for part in shapely.get_parts(whole):
        if part.equals(part.convex_hull) or part.geom_type == "Point":
            found.append(convex_outline(shapely.get_coordinates(part)))
            continue
        if part.geom_type == "Polygon":
            pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(part))
        else:
            line = shapely.get_coordinates(part)
            pieces = [shapely.linestrings(line[k : k + 2]) for k in range(len(line) - 1)]
        found += [convex_outline(shapely.get_coordinates(piece)) for piece in pieces]
    return found


def _clipped_ends(corners: Array, edges: Indices, low: float, high: float) -> Array:
    """(N, 3) corners between two heights, and where edges cross these."""
    heights = corners[:, 2]
    found = [corners[(heights >= low) & (heights <= high)]]
    a, b = corners[edges[:, 0]], corners[edges[:, 1]]
    for level in (low, high):
        cut = (a[:, 2] - level) * (b[:, 2] - level) < 0
        share = (level - a[cut, 2]) / (b[cut, 2] - a[cut, 2])
        found.append(a[cut] + share[:, None] * (b[cut] - a[cut]))
    return np.concatenate(found)


def _clipped_triangles(triangles: Array, low: float, high: float) -> NDArray[np.object_]:
    """(N,) what triangles (T, 3, 3) have between two heights, seen from above."""
    heights = triangles[:, :, 2]
    triangles = triangles[(heights.max(axis=1) > low) & (heights.min(axis=1) < high)]
    heights = triangles[:, :, 2]
    whose, corner = np.nonzero((heights >= low) & (heights <= high))
    owners, points = [whose], [triangles[whose, corner, :2]]
    for level in (low, high):
        for k in range(3):
            a, b = triangles[:, k], triangles[:, (k + 1) % 3]
            cut = np.flatnonzero((a[:, 2] - level) * (b[:, 2] - level) < 0)
            share = (level - a[cut, 2]) / (b[cut, 2] - a[cut, 2])
            owners.append(cut)
            points.append(a[cut, :2] + share[:, None] * (b[cut, :2] - a[cut, :2]))
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    _, numbers = np.unique(owner[order], return_inverse=True)
    return np.asarray(shapely.convex_hull(shapely.multipoints(np.concatenate(points)[order], indices=numbers)))


def directions(polygons: list[Array]) -> tuple[Array, Array]:
    """(N,) angles of the sides of outlines (K, 2), rad within a quarter turn, and (N,) their lengths, m."""
    sides = np.concatenate([np.roll(p, -1, axis=0) - p for p in polygons])
    lengths = np.linalg.norm(sides, axis=1)
    kept = lengths > _SHORT
    return np.arctan2(sides[kept, 1], sides[kept, 0]) % (np.pi / 2), lengths[kept]
