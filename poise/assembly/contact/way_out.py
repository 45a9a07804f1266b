"""Along which straight line an object can be taken away without hitting another."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import cast

import coal
import numpy as np

from poise.assembly.contact.contacts import Interface
from poise.assembly.contact.penetration import convex_geometry, penetration_depth
from poise.assembly.contact.placed import PlacedBody, placed
from poise.assembly.scene import Assembly, RigidObject
from poise.geometry import Pose, plane_axes, unit
from poise.types import Array

_AHEAD = 1e-3
"""m, that an object is moved before what it overlaps there counts."""
_STEPS = 24
"""Places on the way at which an object that is not convex, or is near one that is not, is looked at."""
_SIDES = 8
"""Directions across gravity that are tried."""


@dataclass(frozen=True, eq=False)
class WayOut:
    """How an object can be taken away.

    Args:
        direction: (3,) of a straight line along which nothing is in its way; None when none was found.
        blocked_by: places in `Assembly.objects` of what has to go before, where that is all movable: the fewest.
    """

    direction: Array | None
    blocked_by: tuple[int, ...] = ()


def way_out(assembly: Assembly, interfaces: Sequence[Interface], place: int, margin: float) -> WayOut:
    """A direction along which an object can be moved out of the assembly, or what has to go before.

    Straight lines are tried: against gravity, away from each contact and from all of them, level, and between level and
    upwards. On the way the object may overlap others by the margin, as it may at rest.

    Args:
        assembly: all objects that are still there.
        interfaces: its contacts.
        place: of the object, in `Assembly.objects`.
        margin: m.
    """
    bodies = [placed(item) for item in assembly.objects]
    bounds = np.array([body.bounds for body in bodies])
    distance = float(np.linalg.norm(bounds[:, 1].max(axis=0) - bounds[:, 0].min(axis=0)))
    fewest: tuple[int, ...] = ()
    for direction in _directions(assembly, interfaces, place):
        step = distance * direction
        low = np.minimum(bounds[place, 0], bounds[place, 0] + step) + margin
        high = np.maximum(bounds[place, 1], bounds[place, 1] + step) - margin
        near = np.all((bounds[:, 0] < high) & (bounds[:, 1] > low), axis=1)
        near[place] = False
        blocking = _blocking(bodies, place, direction, distance, np.flatnonzero(near).tolist(), margin)
        if blocking is None:
            continue
        if not blocking:
            return WayOut(direction)
        if not fewest or len(blocking) < len(fewest):
            fewest = blocking
    return WayOut(None, fewest)


def _blocking(
    bodies: Sequence[PlacedBody], place: int, direction: Array, distance: float, near: Sequence[int], margin: float
) -> tuple[int, ...] | None:
    """Which bodies near the way of one are in its way; None when one of them is fixed."""
    blocking = []
    for number in sorted(near, key=lambda number: not bodies[number].item.fixed):
        if _hits(bodies[place], direction, distance, bodies[number], margin):
            if bodies[number].item.fixed:
                return None
            blocking.append(number)
    return tuple(blocking)


def _hits(body: PlacedBody, direction: Array, distance: float, other: PlacedBody, margin: float) -> bool:
    """Whether a body overlaps another by more than a margin when it is moved by a distance along a direction."""
    if body.polyhedron.convex and other.polyhedron.convex:
        return _sweep_depth(body.item, direction, distance, other.item) > margin
    return not _clear(body.item, direction, distance, other, margin)


def _directions(assembly: Assembly, interfaces: Sequence[Interface], place: int) -> list[Array]:
    gravity = np.asarray(assembly.gravity)
    strength = float(np.linalg.norm(gravity))
    up = -gravity / strength if strength > 0 else np.array([0.0, 0.0, 1.0])
    away = [i.normal if i.second == place else -i.normal for i in interfaces if place in (i.first, i.second)]
    across = plane_axes(up)
    turns = 2 * np.pi * np.arange(_SIDES) / _SIDES
    level = [np.cos(turn) * across[0] + np.sin(turn) * across[1] for turn in turns]
    together = [unit(sum(away, np.zeros(3)))] if away and np.linalg.norm(sum(away, np.zeros(3))) > 1e-6 else []
    wanted = [up, *together, *away, *level, *(unit(side + up) for side in level)]
    kept: list[Array] = []
    for direction in wanted:
        if all(float(direction @ other) < 1 - 1e-6 for other in kept):
            kept.append(direction)
    return kept


def _sweep_depth(item: RigidObject, direction: Array, distance: float, other: RigidObject) -> float:
    """How deep what a convex body sweeps, a little ahead of where it is, overlaps another, m."""
    corners = item.vertices
    points = coal.StdVec_Vec3s()
    points.extend(list(np.concatenate([corners + _AHEAD * direction, corners + distance * direction])))
    swept = coal.Convex.convexHull(points, False, "")
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    at = coal.Transform3s(other.pose.rotation, other.pose.translation)
    shape = convex_geometry(cast(Hashable, other.shape))
    if not coal.collide(swept, coal.Transform3s.Identity(), shape, at, request, result):
        return 0.0
    return float(max(0.0, -result.getContact(0).penetration_depth))


def _clear(item: RigidObject, direction: Array, distance: float, other: PlacedBody, margin: float) -> bool:
    """Whether a body stays outside of another at places on the way that are closer together at its beginning."""
    for step in distance * np.linspace(0.0, 1.0, _STEPS + 1)[1:] ** 2:
        pose = Pose(item.pose.rotation, item.pose.translation + step * direction)
        moved = PlacedBody(replace(item, pose=pose))
        if np.any(moved.bounds[0] > other.bounds[1]) or np.any(moved.bounds[1] < other.bounds[0]):
            return True
        if penetration_depth(moved, other) > margin:
            return False
    return True
