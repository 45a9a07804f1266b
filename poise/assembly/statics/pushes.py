"""Forces that are asked about: where on which object, and along which direction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from poise.assembly.contact import distance_to_triangles
from poise.assembly.scene import Assembly, Box, Cylinder, RigidObject, Sphere
from poise.errors import ErrorCode, InputError
from poise.geometry import wrench_of_force
from poise.ranges import directions_of, vectors
from poise.types import Array

_WITHOUT_TREE = 4
"""Up to so many points, distances to all triangles take less time than a tree of these."""


@dataclass(frozen=True, eq=False)
class Push:
    """A force on an object.

    Args:
        object: id.
        point: (3,) where, in the assembly's frame, m.
        direction: (3,) of any length but zero, in the assembly's frame; only among several pushes that grow together
            does the length count, as the ratio of the forces.
    """

    object: str
    point: ArrayLike
    direction: ArrayLike


@dataclass(frozen=True, eq=False)
class Loads:
    """Wrenches that grow together, for many questions at once.

    Args:
        question: (N,) to which question each wrench belongs, ascending.
        place: (N,) in `Assembly.objects`.
        wrench: (N, 6) N and N m about the world's origin; robustness is the factor on all wrenches of a question.
        count: number of questions.
    """

    question: NDArray[np.int64]
    place: NDArray[np.int64]
    wrench: Array
    count: int


def loads_of(assembly: Assembly, pushes: Sequence[Push | Sequence[Push]], tolerance: float) -> Loads:
    """Check pushes and turn them into wrenches of 1 N; pushes of one sequence grow together.

    The largest of several has 1 N.

    Raises:
        InputError: OBJECT_UNKNOWN, NOT_FINITE, BAD_INPUT for a direction of no length, POINT_OFF_SURFACE.
    """
    groups = [[entry] if isinstance(entry, Push) else list(entry) for entry in pushes]
    flat = [push for group in groups for push in group]
    question = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    place = np.array([assembly.place_of(push.object) for push in flat], dtype=np.int64)
    points = vectors("point", [push.point for push in flat], where="pushes: ")
    directions = directions_of([push.direction for push in flat], "pushes: ")
    lengths = np.linalg.norm(directions, axis=1)
    for index in np.unique(place):
        rows = np.flatnonzero(place == index)
        _check_on_surface(assembly.objects[index], points[rows], rows, tolerance)
    largest = np.ones(len(groups))
    if len(flat):
        largest[np.unique(question)] = np.maximum.reduceat(lengths, np.unique(question, return_index=True)[1])
    return Loads(question, place, wrench_of_force(directions / largest[question, None], points), len(groups))


def _check_on_surface(item: RigidObject, points: Array, rows: NDArray[np.int64], tolerance: float) -> None:
    distance = surface_distance(item, points)
    worst = int(distance.argmax())
    if distance[worst] > tolerance:
        raise InputError(
            ErrorCode.POINT_OFF_SURFACE,
            f"push {rows[worst]}: the point {points[worst].tolist()} is {distance[worst] * 1e3:.1f} mm off the surface "
            f"of {item.id} (up to {tolerance * 1e3:g} mm is accepted)",
            object=item.id,
            distance=float(distance[worst]),
        )


def surface_distance(item: RigidObject, points: Array) -> Array:
    """(N,) distance of points (N, 3), in the assembly's frame, from the surface of an object, m."""
    local = item.pose.undo(points)
    if isinstance(item.shape, Box):
        return _signed_to_surface(np.abs(local) - np.array(item.shape.size) / 2)
    if isinstance(item.shape, Cylinder):
        across = np.linalg.norm(local[:, :2], axis=1) - item.shape.radius
        return _signed_to_surface(np.stack([across, np.abs(local[:, 2]) - item.shape.length / 2], axis=1))
    if isinstance(item.shape, Sphere):
        return _signed_to_surface(np.linalg.norm(local, axis=1)[:, None] - item.shape.radius)
    triangles = item.shape.polyhedron.vertices[item.shape.polyhedron.triangles]
    centres = triangles.mean(axis=1)
    reach = float(np.linalg.norm(triangles - centres[:, None], axis=2).max())
    if len(local) <= _WITHOUT_TREE:
        away = np.linalg.norm(centres - local[:, None], axis=2)
        candidates = [np.flatnonzero(row <= row.min() + reach) for row in away]
    else:
        tree = cKDTree(centres)
        nearest, _ = tree.query(local)
        candidates = tree.query_ball_point(local, nearest + reach)
    return np.array([distance_to_triangles(p, triangles[near]) for p, near in zip(local, candidates, strict=True)])


def _signed_to_surface(beyond: Array) -> Array:
    """(N,) distance from a surface, of how far points are beyond each of its sides (N, S); negative is inside."""
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.asarray(outside + np.abs(np.minimum(beyond.max(axis=1), 0.0)))
