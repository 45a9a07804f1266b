"""How fast a base may accelerate, turn and tilt before something on it slips or topples."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from poise.assembly.robustness.elastic_limits import ElasticLimits, inertial_loads
from poise.assembly.robustness.gravity_cone import GravityCone
from poise.assembly.robustness.registry import DEFAULT_MODEL, ROBUSTNESS_MODELS
from poise.assembly.scene import Assembly
from poise.assembly.statics import Analysis, BlockAnalysis, Deadline, Loads
from poise.errors import ErrorCode, InputError
from poise.geometry import sphere_directions, unit
from poise.ranges import directions_of, vectors
from poise.threads import in_one_thread
from poise.types import Array, Mask

_FASTEST = 1000.0
"""Accelerations above this are not computed, m/s2."""
# Directions all around, besides those asked for, from which the polytope is made.
_AROUND = 90


@dataclass(frozen=True, eq=False)
class AccelerationLimits:
    """How fast a base may accelerate, in the assembly's frame; a common factor on all masses changes nothing.

    The sustained combinations of linear acceleration, angular acceleration and squared angular speed form a convex
    set: shares of their single limits that add up to at most 1 are safe together.

    Args:
        directions: (D, 3) unit vectors.
        limits: (D,) m/s2; inf above `_FASTEST`.
        first_to_move: ids of what moves first, for each direction; empty when nothing does.
        normals, offsets: (F, 3), (F,) every acceleration a with normals @ a <= offsets is sustained, m/s2.
        angular_acceleration: rad/s2, either way about an axis along z of the assembly's frame, from rest.
        angular_speed: rad/s, about the same axis, when steady.
        complete: the deadline left time for all; otherwise the limits are what is certified.
        doubtful: (D,) elastic contacts, which must confirm limits where contact forces have a choice, were not asked in
            time, or were not followed until they collapse: the limit is what was confirmed, and more may be sustained.
    """

    directions: Array
    limits: Array
    first_to_move: tuple[tuple[str, ...], ...]
    normals: Array
    offsets: Array
    angular_acceleration: float
    angular_speed: float
    complete: bool
    doubtful: Mask

    def tilts(self, gravity: float) -> Array:
        """(D,) how far the base may be tilted so that `directions`, if level, point uphill, rad.

        What a tilt does is what an acceleration uphill does, up to a factor on gravity that no limit depends on.
        """
        return np.asarray(np.arctan(self.limits / gravity))

    def left_by(self, speed: float, acceleration: float) -> float:
        """The share of all limits that a base leaves which turns already, rad/s and rad/s2; 0 when that is too much."""
        taken = _share(abs(acceleration), self.angular_acceleration) + _share(speed**2, self.angular_speed**2)
        return max(0.0, 1.0 - taken)

    def while_turning(self, speed: float, acceleration: float) -> "AccelerationLimits":
        """What is sustained while the base turns: certified, since the sustained combinations are convex.

        No more than that: accelerations that counteract the turning may be larger.
        """
        left = self.left_by(speed, acceleration)
        limits = self.limits * left if left else np.zeros_like(self.limits)
        return replace(self, limits=limits, offsets=self.offsets * left)


@in_one_thread
def acceleration_limits(
    assembly: Assembly | Analysis,
    directions: int | Array = 72,
    deadline: float | None = None,
    turning: bool = True,
    axis: Sequence[float] = (0.0, 0.0),
) -> AccelerationLimits:
    """How fast the base of an assembly may accelerate.

    An accelerating base is a resting one under another gravity. Sustained effective gravities form a convex cone:
    in closed form for every body on one interface; blocks with cycles are followed on elastic contacts.

    Args:
        assembly: prepared as an `Analysis` when more will be asked.
        directions: (D, 3) any lengths but zero; or how many in the horizontal plane, counter-clockwise from x.
        deadline: s.
        turning: angular acceleration and speed too (NaN otherwise).
        axis: (2,) x and y of the axis about which the base turns, m.

    Raises:
        InputError: BAD_INPUT or NOT_FINITE for directions; INTERPENETRATION, FLOATING.
        NoAnswerError: UNSTABLE, SOLVER_FAILED.
    """
    clock = Deadline.after(deadline)
    asked = _directions(directions)
    vectors("position", [axis], 2, "axis: ")
    analysis = Analysis.of(assembly, deadline=clock)
    stands = not analysis.require_stable(clock).doubtful
    all_directions = np.concatenate([asked, np.vstack([np.eye(3), -np.eye(3)]), sphere_directions(_AROUND)])
    wanted = np.arange(len(all_directions)) < len(asked) + 6
    limits = np.full(len(all_directions), _FASTEST)
    movers: list[Callable[[], tuple[str, ...]] | None] = [None] * len(asked)
    doubtful = np.full(len(asked), not stands)
    complete = stands
    for block in analysis.blocks:
        found, mechanisms, checked, done = _block_limits(block, all_directions, wanted, limits, clock)
        complete &= done
        lower = found < limits
        doubtful = np.where(lower[: len(asked)], ~checked[: len(asked)], doubtful)
        for row in np.flatnonzero(lower[: len(asked)]).tolist():
            movers[row] = mechanisms(row)
        limits = np.where(lower, found, limits)
    if not stands:
        limits[:] = 0.0
    normals, offsets = _polytope(all_directions * limits[:, None])
    angular, speed, done = _turning(analysis, axis, clock) if turning else (np.nan, np.nan, True)
    names = tuple(() if mover is None else mover() for mover in movers)
    shown = np.where(limits >= _FASTEST, np.inf, limits)[: len(asked)]
    return AccelerationLimits(asked, shown, names, normals, offsets, angular, speed, complete and done, doubtful)


def _share(value: float, most: float) -> float:
    return 0.0 if value == 0 else value / most if most > 0 else np.inf


def _directions(directions: int | Array) -> Array:
    if isinstance(directions, int):
        if not 1 <= directions <= 100_000:
            raise InputError(ErrorCode.BAD_INPUT, f"directions: {directions}, expected 1 to 100000")
        azimuth = 2 * np.pi * np.arange(directions) / directions
        return np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(directions)], axis=1)
    given = directions_of(directions, "directions: ")
    if not len(given):
        raise InputError(ErrorCode.BAD_INPUT, "directions: none is given")
    return unit(given)


Movers = Callable[[int], Callable[[], tuple[str, ...]]]


def _block_limits(
    block: BlockAnalysis, directions: Array, wanted: Mask, most: Array, deadline: Deadline
) -> tuple[Array, Movers, Mask, bool]:
    """Limits (D,) of one block, m/s2, and what moves first at each; which were checked; whether all are known.

    Where contact forces have a choice, only in the directions wanted (D,), and no more than `most` (D,).
    """
    objects = block.structure.assembly.objects
    gravity = np.asarray(block.structure.assembly.gravity)
    known = np.ones(len(directions), dtype=bool)
    if block.geometry.statically_determinate:
        members = block.block.members[0]
        limits, _ = GravityCone.of(block).factors(gravity, -directions)
        names = tuple(objects[place].id for place in members)
        return limits, lambda _: lambda: names, known, True
    # Slow: the directions around are left out of the polytope.
    found = ElasticLimits(block, inertial_loads(block), directions, most * wanted, deadline).solve()

    def movers(row: int) -> Callable[[], tuple[str, ...]]:
        mechanism = found.falls.get(row)
        return lambda: () if mechanism is None else tuple(objects[place].id for place in mechanism.places)

    return found.limits, movers, found.known, bool(found.known.all()) or not deadline.passed


def _polytope(points: Array) -> tuple[Array, Array]:
    """Normals (F, 3) and offsets (F,) of the hull of points around the origin."""
    try:
        facets = ConvexHull(points).equations
    except QhullError:  # flat: nothing is sustained in some direction
        return np.vstack([np.eye(3), -np.eye(3)]), np.zeros(6)
    facets = np.unique(np.round(facets, 12), axis=0)
    return facets[:, :3], np.maximum(-facets[:, 3], 0.0)


def _turning(analysis: Analysis, centre: Sequence[float], deadline: Deadline) -> tuple[float, float, bool]:
    """Largest angular acceleration either way, rad/s2, and largest steady speed, rad/s, about z through a centre."""
    axis, origin = np.array([0.0, 0.0, 1.0]), np.array([*centre, 0.0])
    question, places, wrenches = [], [], []
    for number, sign in enumerate((1.0, -1.0)):
        for place in analysis.structure.movable:
            item = analysis.assembly.objects[place]
            force = -item.mass * sign * np.cross(axis, item.com_in_world - origin)
            moment = np.cross(item.com_in_world, force) - sign * item.inertia_in_world @ axis
            question.append(number)
            places.append(place)
            wrenches.append(np.concatenate([force, moment]))
    for place in analysis.structure.movable:
        item = analysis.assembly.objects[place]
        force = item.mass * (item.com_in_world - origin) * [1, 1, 0]
        moment = np.cross(item.com_in_world, force) - np.cross(axis, item.inertia_in_world @ axis)
        question.append(2)
        places.append(place)
        wrenches.append(np.concatenate([force, moment]))
    loads = Loads(np.array(question), np.array(places), np.array(wrenches).reshape(-1, 6), 3)
    found = ROBUSTNESS_MODELS.find(DEFAULT_MODEL).solve(analysis, loads, deadline)
    return float(found.lower[:2].min()), float(np.sqrt(found.lower[2])), found.complete
