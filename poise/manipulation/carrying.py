"""Pick, carry, place: a grasp that serves at both ends, and the motions between them."""

import time
from dataclasses import dataclass, replace

import numpy as np

from poise.assembly.analysis import Analysis
from poise.assembly.geometry import Array
from poise.assembly.scene import RigidObject
from poise.errors import ErrorCode, NoAnswerError
from poise.manipulation.cell import Cell
from poise.manipulation.hand import Grasp
from poise.manipulation.reach import Ends, Reach
from poise.manipulation.rrt import find_way, shortened
from poise.manipulation.timing import Limits, timed
from poise.simulation import WaypointTrajectory

GENTLY = 0.1
"""m/s of the tool on the straight ways."""
HOLD_SHARE = 0.8
"""Of the acceleration that the grip bears."""
GRASPS = 3
"""Grasps for which a way is looked for before it is given up."""


@dataclass(frozen=True, eq=False)
class Phase:
    """One part of a transfer.

    Args:
        name: reach, approach, lift, carry, lower, retreat or return.
        motions: one after another, each from rest to rest.
        opening: m, of the fingers meanwhile.
        holding: the object is in the hand.
    """

    name: str
    motions: tuple[WaypointTrajectory, ...]
    opening: float
    holding: bool

    @property
    def seconds(self) -> float:
        """Of all motions."""
        return float(sum(motion.duration for motion in self.motions))


@dataclass(frozen=True, eq=False)
class Transfer:
    """How an object gets to its place; the arm ends where it began.

    Args:
        ends: grasp and approach.
        phases: in order; fingers close before the first that holds, and open after the last.
        seconds: of planning.
    """

    ends: Ends
    phases: tuple[Phase, ...]
    seconds: float

    @property
    def grasp(self) -> Grasp:
        """Of the object."""
        return self.ends.grasp


def plan_transfer(
    reach: Reach,
    after: Analysis,
    placed: RigidObject,
    limits: Limits = Limits(),  # noqa: B008
    seconds: float = 10.0,
    seed: int = 0,
) -> Transfer:
    """Plan how the arm takes an object from where it lies to its place.

    Args:
        reach: of the object, where it lies.
        after: the assembly with the object at its place.
        placed: the object there.
        limits: of the motions; what the grip bears limits them further while it holds.
        seconds: for looking for ways.
        seed: same seed, same motion (unless time runs out).

    Raises:
        NoAnswerError: UNREACHABLE, with data `step`: grasping when no grasp serves at both ends, motion when no way
            was found between them.
    """
    begun = time.monotonic()
    number = 0
    for number, ends in enumerate(reach.all_ends(after, placed), 1):
        phases = _phases(reach, ends, placed, limits, begun + seconds, seed)
        if phases is not None:
            return Transfer(ends, phases, time.monotonic() - begun)
        if number == GRASPS or time.monotonic() > begun + seconds:
            break
    step = "motion" if number else "grasping"
    why = f"no free way was found for {number} grasps" if number else "no grasp serves where it lies and where it goes"
    raise NoAnswerError(ErrorCode.UNREACHABLE, f"{placed.id}: {why}; place it elsewhere, or move the arm", step=step)


def _phases(
    reach: Reach, ends: Ends, placed: RigidObject, limits: Limits, deadline: float, seed: int
) -> tuple[Phase, ...] | None:
    rng = np.random.default_rng(seed)
    pick, place, grasp = ends.pick, ends.place, ends.grasp
    at_pick, at_place = reach.open_cell(grasp, reach.item), reach.open_cell(grasp, placed)
    carrying, opening = reach.carrying_cell(grasp), reach.arm.hand.opening(grasp.width)
    # Fingers closed, and what is held touching its support.
    closed, bare, home = (
        Cell(reach.arm, around, 0.0) for around in ((*reach.around, reach.item), reach.around, (*reach.around, placed))
    )
    held = replace(limits, acceleration=min(limits.acceleration, HOLD_SHARE * ends.hold))
    com = grasp.object_tcp.inverse().act(reach.item.pose.undo(reach.item.com_in_world))
    ways = (
        ("reach", _between(reach, reach.start, pick.hand_away[-1], closed, rng, deadline), closed, 0.0, False),
        ("approach", pick.hand_away[::-1], at_pick, opening, False),
        ("lift", pick.object_away, bare, grasp.width, True),
        (
            "carry",
            _between(reach, pick.object_away[-1], place.object_away[-1], carrying, rng, deadline),
            carrying,
            grasp.width,
            True,
        ),
        ("lower", place.object_away[::-1], bare, grasp.width, True),
        ("retreat", place.hand_away, at_place, opening, False),
        ("return", _between(reach, place.hand_away[-1], reach.start, home, rng, deadline), home, 0.0, False),
    )
    phases = []
    for name, way, cell, wide, holding in ways:
        if way is None:
            return None
        slow = held if holding else limits
        if name in ("approach", "lift", "lower", "retreat"):
            slow = replace(slow, speed=min(slow.speed, GENTLY))
        motions = timed(reach.arm, way, cell, com if holding else np.zeros(3), slow)
        phases.append(Phase(name, tuple(motions), wide, holding))
    return tuple(phases)


def _between(
    reach: Reach, start: Array, goal: Array, cell: Cell, rng: np.random.Generator, deadline: float
) -> Array | None:
    if not (cell.free(start) and cell.free(goal)):
        return None
    bounds = reach.arm.lower, reach.arm.upper
    way = find_way(start, goal, cell.free_between, bounds, rng, deadline)
    return None if way is None else shortened(way, cell.free_between, rng, deadline)
