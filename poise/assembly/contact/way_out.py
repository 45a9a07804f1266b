"""Along which straight line an object can be taken away without hitting another."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import cast

import coal
import numpy as np

from poise.assembly.contact.contacts import Interface
from poise.assembly.contact.penetration import convex_geometry, convex_overlap, penetration_depth
from poise.assembly.contact.placed import PlacedBody, placed
from poise.assembly.scene import Assembly, RigidObject
from poise.geometry import Pose, plane_axes, unit
from poise.types import Array

_AHEAD = 1e-3
"""m, that an object is moved before what it overlaps there counts."""
_STEPS, _MOST = 12, 200
"""Places on the way at which hollow objects are looked at, and how many at most where the way is long."""
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


def way_out(
    assembly: Assembly,
    interfaces: Sequence[Interface],
    place: int,
    margin: float,
    ended: Callable[[], bool] = lambda: False,
) -> WayOut:
    """A direction along which an object can be moved out of the assembly, or what has to go before.

    Straight lines are tried: against gravity, away from each contact and from all of them, level, between level and
    upwards, and along the axes of what it touches, since a rack may be turned in any way. On the way the object may
    overlap others by the margin, as it may at rest.

    Args:
        assembly: all objects that are still there.
        interfaces: its contacts.
        place: of the object, in `Assembly.objects`.
        margin: m.
        ended: whether the time for it is over: what is known by then is returned.
    """
    bodies = [placed(item) for item in assembly.objects]
    bounds = np.array([body.bounds for body in bodies])
    distance = float(np.linalg.norm(bounds[:, 1].max(axis=0) - bounds[:, 0].min(axis=0)))
    fewest: tuple[int, ...] = ()
    for direction in _directions(assembly, interfaces, place):
        if ended():
            break
        step = distance * direction
        low = np.minimum(bounds[place, 0], bounds[place, 0] + step) + margin
        high = np.maximum(bounds[place, 1], bounds[place, 1] + step) - margin
        near = np.all((bounds[:, 0] < high) & (bounds[:, 1] > low), axis=1)
        near[place] = False
        blocking = _blocking(bodies, place, direction, distance, np.flatnonzero(near).tolist(), margin, ended)
        if blocking is None:
            continue
        if not blocking:
            return WayOut(direction)
        if not fewest or len(blocking) < len(fewest):
            fewest = blocking
    return WayOut(None, fewest)


def _blocking(
    bodies: Sequence[PlacedBody],
    place: int,
    direction: Array,
    distance: float,
    near: Sequence[int],
    margin: float,
    ended: Callable[[], bool],
) -> tuple[int, ...] | None:
    """Which bodies near the way of one are in its way; None when one of them is fixed, or the time is over."""
    blocking = []
    for number in sorted(near, key=lambda number: not bodies[number].item.fixed):
        if ended():
            return None
        if _hits(bodies[place], direction, distance, bodies[number], margin):
            if bodies[number].item.fixed:
                return None
            blocking.append(number)
    return tuple(blocking)


def _hits(body: PlacedBody, direction: Array, distance: float, other: PlacedBody, margin: float) -> bool:
    """Whether a body overlaps another by more than a margin when it is moved by a distance along a direction."""
    if _sweep_depth(body.item, direction, distance, other.item) <= margin:
        return False
    convex = body.polyhedron.convex and other.polyhedron.convex
    return convex or not _clear(body, direction, distance, other, margin)


def _directions(assembly: Assembly, interfaces: Sequence[Interface], place: int) -> list[Array]:
    gravity = np.asarray(assembly.gravity)
    strength = float(np.linalg.norm(gravity))
    up = -gravity / strength if strength > 0 else np.array([0.0, 0.0, 1.0])
    away = [i.normal if i.second == place else -i.normal for i in interfaces if place in (i.first, i.second)]
    across = plane_axes(up)
    turns = 2 * np.pi * np.arange(_SIDES) / _SIDES
    level = [np.cos(turn) * across[0] + np.sin(turn) * across[1] for turn in turns]
    together = [unit(sum(away, np.zeros(3)))] if away and np.linalg.norm(sum(away, np.zeros(3))) > 1e-6 else []
    touched = {i.first if i.second == place else i.second for i in interfaces if place in (i.first, i.second)}
    axes = [
        sign * axis for other in sorted(touched) for axis in assembly.objects[other].pose.rotation.T for sign in (1, -1)
    ]
    wanted = [up, *together, *away, *level, *(unit(side + up) for side in level), *axes]
    kept: list[Array] = []
    for direction in wanted:
        if all(float(direction @ other) < 1 - 1e-6 for other in kept):
            kept.append(direction)
    return kept


def _sweep_depth(item: RigidObject, direction: Array, distance: float, other: RigidObject) -> float:
    """How deep what the convex hull of a body sweeps, a little ahead of where it is, overlaps that of another, m."""
    corners = item.vertices
    points = coal.StdVec_Vec3s()
    points.extend(list(np.concatenate([corners + _AHEAD * direction, corners + distance * direction])))
    swept = coal.Convex.convexHull(points, False, "")
    at = coal.Transform3s(other.pose.rotation, other.pose.translation)
    shape = convex_geometry(cast(Hashable, other.shape))
    return convex_overlap(swept, coal.Transform3s.Identity(), shape, at)


def _clear(body: PlacedBody, direction: Array, distance: float, other: PlacedBody, margin: float) -> bool:
    """Whether a body overlaps another by no more than a margin at places on the way, where their bounds meet."""
    for step in _looked_at(body.bounds, direction, distance, other.bounds).tolist():
        pose = Pose(body.item.pose.rotation, body.item.pose.translation + step * direction)
        if penetration_depth(PlacedBody(replace(body.item, pose=pose)), other) > margin:
            return False
    return True


def _looked_at(bounds: Array, direction: Array, distance: float, other: Array) -> Array:
    """Distances along the way at which bounds (2, 3) meet others: dense at first, then half a length apart."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort(np.array([other[0] - bounds[1], other[1] - bounds[0]]) / direction, axis=0)
    ends = ends[:, np.abs(direction) > 1e-9]  # the others were compared with all of the way
    first, last = max(0.0, float(ends[0].max())), min(distance, float(ends[1].min()))
    if first >= last:
        return np.zeros(0)
    apart = max(float(np.abs(direction) @ (bounds[1] - bounds[0])) / 2, (last - first) / _MOST)
    dense = first + (last - first) * np.linspace(0.0, 1.0, _STEPS + 1)[1:] ** 2
    return np.sort(np.concatenate([dense, np.arange(first + apart, last, apart)]))
