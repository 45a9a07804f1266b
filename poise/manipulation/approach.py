"""From where an object is brought to its place: the way on which a touch does least harm (the lesson of 5.8.2)."""

import coal
import numpy as np

from poise.assembly import Analysis, Push, RigidObject, assess
from poise.assembly.statics import loads_of
from poise.errors import PoiseError
from poise.geometry import Pose, plane_axes, rotation_about, unit
from poise.manipulation.bodies import geometry_of
from poise.types import Array

_NEAR = 0.02
"""m from an object that moves within which another one may be touched by mistake."""
_ASIDE = 0.003
"""m above its place, where the object touches nothing yet."""
_TILTS = np.radians([20.0, 40.0])
_AZIMUTHS = 8
_ENOUGH = 50.0
"""N that no careful arm exceeds: no more is asked."""
_COARSE = 0.05
"""Relative tolerance of what elastic contacts hold; it is a lower bound anyway."""


def approach_directions(
    before: Analysis, after: Analysis, item: RigidObject, count: int | None = None
) -> list[tuple[Array, float]]:
    """Directions (3,) in which an object can come to its place, the most forgiving first.

    What the object or the hand would drag along when it touches a neighbour is a push on that neighbour in the
    direction of the motion, at the nearest point. Robustness to it is asked of the assembly as it is before.

    Args:
        before: the assembly without the object.
        after: with it.
        item: the object at its place.
        count: how many of the most forgiving directions are wanted; None: all.

    Returns:
        Unit vectors along which the object moves last, and the least robustness, N, of what is near to a push along
        each, confirmed by elastic contacts and at most `_ENOUGH`; infinite when nothing movable is near.
    """
    up = -unit(np.asarray(before.assembly.gravity))
    away = _normals_from_supports(after, item)
    directions = [direction for direction in _candidates(up) if np.all(away @ -direction > -1e-3)]
    least = _least(before, item, directions)
    confirmed = set[int]()
    while True:
        # Equally good ones stay in the order of the candidates: straight down first.
        order = sorted(range(len(directions)), key=lambda number: -min(least[number], _ENOUGH))[:count]
        doubtful = next((number for number in order if number not in confirmed), None)
        if doubtful is None:
            return [(directions[number], least[number]) for number in order]
        least[doubtful] = _confirmed(before, _touches(before, item, directions[doubtful]), least[doubtful])
        confirmed.add(doubtful)


def _candidates(up: Array) -> list[Array]:
    side = plane_axes(up)[0]
    turned = [rotation_about(up, 2 * np.pi * k / _AZIMUTHS) @ side for k in range(_AZIMUTHS)]
    return [-up, *(-np.cos(tilt) * up + np.sin(tilt) * across for tilt in _TILTS for across in turned)]


def _normals_from_supports(analysis: Analysis, item: RigidObject) -> Array:
    """(N, 3) normals of the contacts of an object, towards it."""
    place = analysis.assembly.place_of(item.id)
    normals = [
        i.normal if i.second == place else -i.normal
        for i in analysis.structure.interfaces
        if place in (i.first, i.second)
    ]
    return np.array(normals).reshape(-1, 3)


def _least(before: Analysis, item: RigidObject, directions: list[Array]) -> list[float]:
    """N, for each direction: the least limit load of what is near; infinite when nothing movable is."""
    touches = [_touches(before, item, direction) for direction in directions]
    pushes = [push for some in touches for push in some]
    least = np.full(len(directions), np.inf)
    if pushes:
        of = np.repeat(np.arange(len(directions)), [len(some) for some in touches])
        np.minimum.at(least, of, _borne(before, pushes))
    return [float(value) for value in least]


def _touches(before: Analysis, item: RigidObject, direction: Array) -> list[Push]:
    """A push on each movable object that is near, along a direction in which the object comes."""
    corners = item.vertices
    low, high = corners.min(axis=0) - _NEAR - _ASIDE, corners.max(axis=0) + _NEAR + _ASIDE
    aside = Pose(item.pose.rotation, item.pose.translation - _ASIDE * direction)
    pushes = []
    for other in before.assembly.objects:
        if other.fixed or np.any(other.vertices.max(axis=0) <= low) or np.any(other.vertices.min(axis=0) >= high):
            continue
        if (point := _nearest(item, aside, other)) is not None:
            pushes.append(Push(other.id, point, direction))
    return pushes


def _borne(before: Analysis, pushes: list[Push]) -> list[float]:
    """N, of each push by limit analysis; one by one where they cannot be answered together."""
    try:
        return [float(result.lower) for result in assess(before, pushes, "limit").results]
    except PoiseError:  # a direction without an answer comes last
        return [0.0] if len(pushes) == 1 else [_borne(before, [push])[0] for push in pushes]


def _confirmed(before: Analysis, pushes: list[Push], least: float) -> float:
    """N, the least of some pushes, at most `_ENOUGH`, lowered to what patches and elastic contacts hold."""
    if not pushes:
        return least
    held = min(least, _ENOUGH)
    loads = loads_of(before.assembly, pushes, before.structure.margin)
    for block in before.blocks:
        _, block_loads = block.loads(loads)
        if not len(block_loads):
            continue
        if (single := block.solvers.single_patch) is not None:
            held = min(held, *single.collapse(block.geometry.units.wrench(block_loads)).factor.tolist())
            continue
        for load in block_loads:
            held = block.solvers.coulomb.factor(load, held, tolerance=_COARSE).value
    return held


def _nearest(item: RigidObject, pose: Pose, other: RigidObject) -> Array | None:
    """The point (3,) of another object that is nearest, when it is near."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    first = coal.Transform3s(pose.rotation, pose.translation)
    second = coal.Transform3s(other.pose.rotation, other.pose.translation)
    shapes = geometry_of(item.shape), geometry_of(other.shape)
    distance = coal.distance(shapes[0], first, shapes[1], second, request, result)
    return np.array(result.getNearestPoint2()) if 0 < distance < _NEAR else None
