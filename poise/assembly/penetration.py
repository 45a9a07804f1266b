"""How deep two solid bodies overlap."""

from collections.abc import Hashable
from functools import lru_cache
from typing import cast

import coal
import numpy as np

from poise.assembly.geometry import Array, Pose
from poise.assembly.placed import PlacedBody
from poise.assembly.shapes import Box, Cylinder, Polyhedron, Shape


def penetration_depth(first: PlacedBody, second: PlacedBody) -> float:
    """How far the bodies overlap, m; 0 where they do not.

    Convex bodies: coal's exact depth. Otherwise the deepest vertex, or middle of a pierced edge, of one in the other.
    """
    bodies = first, second
    if all(body.polyhedron.convex for body in bodies):
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        shapes = [convex_geometry(cast(Hashable, body.item.shape)) for body in bodies]
        places = [coal.Transform3s(body.item.pose.rotation, body.item.pose.translation) for body in bodies]
        if not coal.collide(shapes[0], places[0], shapes[1], places[1], request, result):
            return 0.0
        return float(max(0.0, -result.getContact(0).penetration_depth))
    return max(_deepest(first, second), _deepest(second, first))


@lru_cache(maxsize=256)
def convex_geometry(shape: Hashable) -> "coal.ShapeBase":
    """What coal asks about, of a convex shape."""
    if isinstance(shape, Box):
        return coal.Box(*shape.size)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length)
    points = coal.StdVec_Vec3s()
    points.extend(list(cast(Shape, shape).polyhedron.vertices))
    return coal.Convex.convexHull(points, False, "")


def _deepest(body: PlacedBody, other: PlacedBody) -> float:
    """Largest depth of points of the body inside the other."""
    low = np.maximum(body.bounds[0], other.bounds[0])
    high = np.minimum(body.bounds[1], other.bounds[1])
    if np.any(low >= high):
        return 0.0
    ends = body.vertices[body.polyhedron.edges[_edges_meeting(body, low, high)]]
    points = np.concatenate([body.vertices, _middles_of_pierced(ends, other)])
    points = points[np.all((points >= low) & (points <= high), axis=1)]
    inside = points[winding_number(points, other.polyhedron, other.item.pose) > 0.5]
    if not len(inside):
        return 0.0
    triangles = other.vertices[other.polyhedron.triangles]
    return float(max(distance_to_triangles(point, triangles) for point in inside[:256]))


def _edges_meeting(body: PlacedBody, low: Array, high: Array) -> Array:
    ends = body.vertices[body.polyhedron.edges]
    return np.asarray(np.all((ends.min(axis=1) <= high) & (ends.max(axis=1) >= low), axis=1))


def _middles_of_pierced(ends: Array, other: PlacedBody) -> Array:
    """Points midway between places where edges (E, 2, 3) cross the surface of the other body (Möller-Trumbore)."""
    corner, *others = np.moveaxis(other.vertices[other.polyhedron.triangles], 1, 0)
    side_1, side_2 = (point - corner for point in others)
    middles = []
    for start, end in ends:
        run = end - start
        p = np.cross(run, side_2)
        determinant = np.einsum("ij,ij->i", side_1, p)
        safe = np.where(np.abs(determinant) > 1e-15, determinant, np.inf)
        offset = start - corner
        u = np.einsum("ij,ij->i", offset, p) / safe
        q = np.cross(offset, side_1)
        v, t = q @ run / safe, np.einsum("ij,ij->i", side_2, q) / safe
        hits = t[(u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1) & np.isfinite(safe)]
        cuts = np.unique(np.concatenate([[0], hits, [1]]))
        middles.append(start + np.outer((cuts[:-1] + cuts[1:]) / 2, run))
    return np.concatenate(middles) if middles else np.zeros((0, 3))


def winding_number(points: Array, polyhedron: Polyhedron, pose: Pose) -> Array:
    """(N,) how often the closed surface winds around each point: 1 inside, 0 outside (van Oosterom, Strackee 1983)."""
    triangles = pose.apply(polyhedron.vertices)[polyhedron.triangles]
    numbers = np.empty(len(points))
    for i, point in enumerate(points):
        a, b, c = np.moveaxis(triangles - point, 1, 0)
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        base = la * lb * lc
        base += np.einsum("ij,ij->i", a, b) * lc + np.einsum("ij,ij->i", b, c) * la + np.einsum("ij,ij->i", c, a) * lb
        numbers[i] = np.arctan2(volume, base).sum() / (2 * np.pi)
    return numbers


def distance_to_triangles(point: Array, triangles: Array) -> float:
    """Least distance from a point (3,) to triangles (T, 3, 3), m."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    square = np.einsum("ij,ij->i", normal, normal)
    safe = np.where(square > 0, square, 1.0)
    weights = np.stack(
        [np.einsum("ij,ij->i", np.cross(q - p, point - p), normal) / safe for p, q in ((b, c), (c, a), (a, b))]
    )
    height = np.abs(np.einsum("ij,ij->i", point - a, normal)) / np.sqrt(safe)
    best = np.where(np.all(weights >= 0, axis=0) & (square > 0), height, np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        run = q - p
        length = np.einsum("ij,ij->i", run, run)
        share = np.clip(np.einsum("ij,ij->i", point - p, run) / np.where(length > 0, length, 1.0), 0, 1)
        best = np.minimum(best, np.linalg.norm(p + share[:, None] * run - point, axis=1))
    return float(best.min())
