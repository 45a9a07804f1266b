"""How deep two solid bodies overlap."""

from collections.abc import Hashable
from functools import lru_cache
from typing import cast

import coal
import numpy as np
from numpy.typing import NDArray

from poise.assembly.contact.placed import PlacedBody, meeting
from poise.assembly.scene import Box, Cylinder, RigidObject, Shape, Sphere
from poise.geometry import cross, lengths
from poise.types import Array, Mask

_CROSSINGS, _PRODUCTS = 60_000, 2_000_000
"""Edges times triangles, and points times planes, looked at together."""
_SLACK = 1e-9
"""Of a triangle's sides, by which a cut may miss it."""
_EXACT = 5e-3
"""m, up to which depths in bodies that are not convex are exact."""
_MARGIN = np.array([[-_EXACT], [_EXACT]])
_PAIRS = 100_000
"""Points times triangles whose distances are found together."""
_UNDER = (1e-3, 2.5e-3)
"""m under both surfaces at which something common is looked for."""
_MOST, _MOST_UNDER = 256, 24
"""Points of a surface, and under it, whose depth in a body that is not convex is measured."""


def penetration_depth(first: PlacedBody, second: PlacedBody) -> float:
    """How far the bodies overlap, m; 0 where they do not.

    Convex bodies: coal's exact depth. Otherwise that of the deepest vertex, or middle of a cut edge, of one in the
    other; or the diameter of a ball that fits into both, a little under such a point.
    """
    bodies = first, second
    if all(body.polyhedron.convex for body in bodies):
        shapes = [convex_geometry(cast(Hashable, body.item.shape)) for body in bodies]
        places = [coal.Transform3s(body.item.pose.rotation, body.item.pose.translation) for body in bodies]
        return convex_overlap(shapes[0], places[0], shapes[1], places[1])
    return max(_deepest(first, second), _deepest(second, first))


def convex_overlap(
    first: "coal.ShapeBase", place: "coal.Transform3s", second: "coal.ShapeBase", there: "coal.Transform3s"
) -> float:
    """How far two convex shapes at their places overlap, m; 0 where they do not."""
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    if not coal.collide(first, place, second, there, request, result):
        return 0.0
    return float(max(0.0, -result.getContact(0).penetration_depth))


def distance_between(first: RigidObject, second: RigidObject) -> float:
    """m between the convex hulls of two objects; 0 where these overlap."""
    shapes, places = [], []
    for item in (first, second):
        shapes.append(convex_geometry(cast(Hashable, item.shape)))
        places.append(coal.Transform3s(item.pose.rotation, item.pose.translation))
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return max(0.0, float(coal.distance(shapes[0], places[0], shapes[1], places[1], request, result)))


@lru_cache(maxsize=256)
def convex_geometry(shape: Hashable) -> "coal.ShapeBase":
    """What coal asks about, of a convex shape."""
    if isinstance(shape, Box):
        return coal.Box(*shape.size)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length)
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius)
    points = coal.StdVec_Vec3s()
    points.extend(list(cast(Shape, shape).polyhedron.vertices))
    return coal.Convex.convexHull(points, False, "")


def _deepest(body: PlacedBody, other: PlacedBody) -> float:
    """Largest depth of points of the body inside the other; beyond `_EXACT` it may be too large or too small."""
    bounds = np.stack([np.maximum(body.bounds[0], other.bounds[0]), np.minimum(body.bounds[1], other.bounds[1])])
    if np.any(bounds[0] >= bounds[1]):
        return 0.0
    # What of either surface meets the other is where both bounds are.
    edges = np.flatnonzero(meeting(body.edge_bounds, bounds))
    ends = body.vertices[body.polyhedron.edges[edges]]
    middles, whose = _middles_between_cuts(ends, other.corners[meeting(other.triangle_bounds, bounds)])
    points = np.concatenate([body.vertices, middles])
    deepest = _largest(points[_inside(points, other, bounds)], (other,), bounds)
    # Where the surfaces coincide, nothing on one is inside the other; but a little under both, a ball fits into both.
    first, second = np.moveaxis(body.polyhedron.normals[body.polyhedron.edge_facets[edges[whose]]], 1, 0)
    under_edges = -(first + second) / (1 + np.einsum("ij,ij->i", first, second) + 1e-9)[:, None]
    inward = np.concatenate([body.polyhedron.inward, under_edges]) @ body.item.pose.rotation.T
    for step in _UNDER if deepest < 2 * max(_UNDER) else ():
        inner = points + step * inward
        inner = inner[_inside(inner, other, bounds)]
        inner = _thinned(inner, _MOST_UNDER)
        inner = inner[_inside(inner, body, bounds)]
        deepest = max(deepest, 2 * _largest(inner, (body, other), bounds))
    return deepest


def _inside(points: Array, body: PlacedBody, bounds: Array) -> Mask:
    """(N,) which points are within bounds (2, 3) and in a body."""
    inside = np.all((points >= bounds[0]) & (points <= bounds[1]), axis=1)
    rows = np.flatnonzero(inside)
    if body.polyhedron.convex:
        inside[rows] = _height_over(points[rows], body) < 0
    else:
        inside[rows] = winding_number(points[rows], body.corners, body.triangle_bounds) > 0
    return np.asarray(inside)


def _largest(points: Array, bodies: tuple[PlacedBody, ...], bounds: Array) -> float:
    """m, how deep the deepest of points inside all of some bodies is under their surfaces; 0 without points."""
    if not all(body.polyhedron.convex for body in bodies):
        points = _thinned(points, _MOST)
    depths = np.full(len(points), np.inf)
    for body in bodies:
        own = -_height_over(points, body) if body.polyhedron.convex else _depths(points, body, bounds)
        depths = np.minimum(depths, own)
    return float(depths.max(initial=0.0))


def _thinned(points: Array, most: int) -> Array:
    """An evenly spaced subset of at most this many points."""
    return points[:: max(1, -(-len(points) // most))]


def _depths(points: Array, body: PlacedBody, bounds: Array) -> Array:
    """(N,) m from points within bounds (2, 3) to a surface; farther than `_EXACT`, to what of it is near the bounds."""
    near = meeting(body.triangle_bounds, bounds + _MARGIN)
    if not near.any():
        near[:] = True
    corners, their_bounds = body.corners[near], body.triangle_bounds[:, near]
    depths, step = np.empty(len(points)), max(1, _PAIRS // len(corners))
    for first in range(0, len(points), step):
        some = points[first : first + step, None]
        close = np.all((their_bounds[0] <= some + _EXACT) & (their_bounds[1] >= some - _EXACT), axis=2)
        close[~close.any(axis=1)] = True
        which, triangles = np.nonzero(close)
        far = _distances(points[first + which], corners[triangles])
        depths[first : first + step] = np.minimum.reduceat(far, np.searchsorted(which, np.arange(len(some))))
    return depths


def _height_over(points: Array, body: PlacedBody) -> Array:
    """(N,) m over a convex body: over the highest of its planes, or a round one's surface; negative inside."""
    if body.cylinder is not None:
        local = body.item.pose.undo(points)
        over_caps = np.abs(local[:, 2]) - body.cylinder.length / 2
        return np.asarray(np.maximum(over_caps, np.linalg.norm(local[:, :2], axis=1) - body.cylinder.radius))
    if body.sphere is not None:
        return np.asarray(np.linalg.norm(body.item.pose.undo(points), axis=1) - body.sphere.radius)
    offsets = np.einsum("ij,ij->i", body.origins, body.normals)
    step = max(1, _PRODUCTS // len(offsets))
    parts = [points[k : k + step] @ body.normals.T - offsets for k in range(0, len(points), step)]
    return np.concatenate([np.zeros(0), *(part.max(axis=1) for part in parts)])


def _middles_between_cuts(ends: Array, triangles: Array) -> tuple[Array, NDArray[np.int64]]:
    """(N, 3) middles of what triangles (T, 3, 3) cut edges (E, 2, 3) into, and (N,) whose they are."""
    middles, whose = [ends.mean(axis=1)], [np.arange(len(ends))]
    step = max(1, _CROSSINGS // max(len(triangles), 1))
    for first in range(0, len(ends) if len(triangles) else 0, step):
        some = ends[first : first + step]
        cuts = _crossings(some, triangles)
        for edge in np.flatnonzero(np.isfinite(cuts).any(axis=1)):
            at = np.unique(np.concatenate([[0], cuts[edge][np.isfinite(cuts[edge])], [1]]))
            middles.append(some[edge, 0] + np.outer((at[:-1] + at[1:]) / 2, some[edge, 1] - some[edge, 0]))
            whose.append(np.full(len(at) - 1, first + edge))
    return np.concatenate(middles), np.concatenate(whose)


def _crossings(ends: Array, triangles: Array) -> Array:
    """(E, T) share of each edge's length at which it crosses each triangle; NaN where not (Möller-Trumbore)."""
    corner = triangles[:, 0]
    side_1, side_2 = triangles[:, 1] - corner, triangles[:, 2] - corner
    run = (ends[:, 1] - ends[:, 0])[:, None]
    offset = ends[:, :1] - corner
    p, q = cross(run, side_2), cross(offset, side_1)
    determinant = np.einsum("tk,etk->et", side_1, p)
    safe = np.where(np.abs(determinant) > 1e-15, determinant, np.nan)
    u = np.einsum("etk,etk->et", offset, p) / safe
    v = np.einsum("etk,etk->et", np.broadcast_to(run, q.shape), q) / safe
    t = np.einsum("tk,etk->et", side_2, q) / safe
    # Where triangles meet, both count.
    return np.where((u >= -_SLACK) & (v >= -_SLACK) & (u + v <= 1 + _SLACK) & (t > 0) & (t < 1), t, np.nan)


def winding_number(points: Array, corners: Array, bounds: Array) -> NDArray[np.int64]:
    """(N,) how often a closed surface winds around each point: 1 inside, 0 outside.

    Counts where a ray upwards leaves and enters. It passes beside edges and corners, always on the same hand, as if
    the point were moved by an infinitesimal in x and by a lesser one in y (Edelsbrunner, Mücke 1990).

    Args:
        points: (N, 3).
        corners: (T, 3, 3) of the triangles, counter-clockwise from outside.
        bounds: (2, T, 3) of them.
    """
    numbers = np.zeros(len(points), dtype=np.int64)
    if not len(points):
        return numbers
    low, (right, back, _) = points.min(axis=0), points.max(axis=0)
    over = meeting(bounds, np.array([low, [right, back, np.inf]]))
    corners, (lowest, highest) = corners[over], bounds[:, over]
    step = max(1, _PRODUCTS // max(len(corners), 1))
    for first in range(0, len(points), step):
        some = points[first : first + step, None]
        beside = np.all((lowest[:, :2] <= some[..., :2]) & (highest[:, :2] >= some[..., :2]), axis=2)
        which, triangles = np.nonzero(beside & (highest[:, 2] >= some[..., 2]))
        place, (a, b, c) = points[first + which], np.moveaxis(corners[triangles], 1, 0)
        hands = [_hand(*ends, place[:, 0], place[:, 1]) for ends in ((a, b), (b, c), (c, a))]
        hit = (hands[0] == hands[1]) & (hands[0] == hands[2])
        hit &= np.einsum("ij,ij->i", cross(b - a, c - a), a - place) * hands[0] > 0
        np.add.at(numbers, first + which[hit], hands[0][hit])
    return numbers


def _hand(a: Array, b: Array, x: Array, y: Array) -> NDArray[np.int64]:
    """(N,) 1 where (x, y), seen from above, is left of the line from a corner a to b (N, 3), -1 where right of it.

    The same to the last bit for both triangles at an edge, but for the sign.
    """
    swapped = (a[:, 0] > b[:, 0]) | ((a[:, 0] == b[:, 0]) & (a[:, 1] > b[:, 1]))
    first, last = np.where(swapped[:, None], b, a), np.where(swapped[:, None], a, b)
    run_x, run_y = last[:, 0] - first[:, 0], last[:, 1] - first[:, 1]
    left = run_x * (y - first[:, 1]) - run_y * (x - first[:, 0])
    left = np.where(left != 0, left, np.where(run_y != 0, -run_y, run_x))
    return np.where((left > 0) != swapped, 1, -1)


def distance_to_triangles(point: Array, triangles: Array) -> float:
    """Least distance from a point (3,) to triangles (T, 3, 3), m."""
    return float(_distances(point, triangles).min())


def _distances(points: Array, triangles: Array) -> Array:
    """(N,) m from points (N, 3), or one point (3,), to triangles (N, 3, 3), one each."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = cross(b - a, c - a)
    square = np.einsum("ij,ij->i", normal, normal)
    safe = np.where(square > 0, square, 1.0)
    weights = [np.einsum("ij,ij->i", cross(q - p, points - p), normal) for p, q in ((b, c), (c, a), (a, b))]
    height = np.abs(np.einsum("ij,ij->i", points - a, normal)) / np.sqrt(safe)
    best = np.where(np.all(np.array(weights) >= 0, axis=0) & (square > 0), height, np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        run = q - p
        length = np.einsum("ij,ij->i", run, run)
        share = np.clip(np.einsum("ij,ij->i", points - p, run) / np.where(length > 0, length, 1.0), 0, 1)
        best = np.minimum(best, lengths(p + share[:, None] * run - points))
    return np.asarray(best)
