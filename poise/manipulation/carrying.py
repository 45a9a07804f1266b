"""Pick, carry, place: a grasp that serves at both ends, and the motions between them."""

import time
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from poise.assembly import Analysis, RigidObject
from poise.errors import ErrorCode, NoAnswerError
from poise.manipulation.arm import Arm
from poise.manipulation.cell import HELD_CLEARANCE, ROBOT_CLEARANCE, Cell
from poise.manipulation.hand import Grasp
from poise.manipulation.reach import NARROW, Ends, Margins, Reach
from poise.manipulation.rrt import find_way, shortened
from poise.manipulation.timing import Limits, timed
from poise.simulation import WaypointTrajectory
from poise.types import Array

_GENTLY = 0.1
"""m/s of the tool on the straight ways."""
_HOLD_SHARE = 0.8
"""Of the acceleration that the grip withstands."""
_WIDE = (0.01, 0.01)
"""m that the robot and what it holds keep from everything on long ways, where there is room."""
ROOMY: Margins = (0.006, 0.0075)
"""m on the straight ways, where there is room: neighbours stand 2 mm and 1 degree from where they are believed, and so
does what is held. What moves away askew, 40 degrees from upright, has risen by 7.6 mm when it is asked about first."""
_GRASPS = 3
"""Grasps for which a way is looked for before it is given up."""


@dataclass(frozen=True, eq=False)
class TransferPhase:
    """One part of a transfer.

    Args:
        name: reach, approach, lift, carry, lower, retreat or return; what is held is not reached for and lifted.
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
    phases: tuple[TransferPhase, ...]
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
    """Plan how the arm takes an object from where it lies, or from the hand, to its place.

    Args:
        reach: of the object, where it lies or is held.
        after: the assembly with the object at its place.
        placed: the object there.
        limits: of the motions; what the grip withstands limits them further while it holds.
        seconds: for looking for ways.
        seed: same seed, same motion (unless time runs out).

    Raises:
        NoAnswerError: UNREACHABLE, with data `step`: grasping when no grasp serves at both ends, motion when no way
            was found between them.
    """
    begun = time.monotonic()
    number = 0
    roomy_first = chain(*(reach.all_ends(after, placed, margins) for margins in (ROOMY, NARROW)))
    for number, ends in enumerate(roomy_first, 1):
        phases = _phases(reach, ends, placed, limits, begun + seconds, seed)
        if phases is not None:
            return Transfer(ends, phases, time.monotonic() - begun)
        if number == _GRASPS or time.monotonic() > begun + seconds:
            break
    step = "motion" if number else "grasping"
    why = f"no free way was found for {number} grasps" if number else "no grasp serves where it lies and where it goes"
    raise NoAnswerError(ErrorCode.UNREACHABLE, f"{placed.id}: {why}; place it elsewhere, or move the arm", step=step)


def _phases(
    reach: Reach, ends: Ends, placed: RigidObject, limits: Limits, deadline: float, seed: int
) -> tuple[TransferPhase, ...] | None:
    rng = np.random.default_rng(seed)
    pick, place, grasp = ends.pick, ends.place, ends.grasp
    at_pick, at_place = reach.open_cell(grasp, reach.item), reach.open_cell(grasp, placed)
    bare, opening = Cell(reach.arm, reach.around, grasp.width), reach.arm.hand.opening(grasp.width)
    with_it_there = (*reach.around, placed)
    to_it = reach.held or free_way(
        reach.arm, reach.start, pick.hand_away[-1], ((*reach.around, reach.item), 0.0, None), rng, deadline
    )
    carried = reach.around, grasp.width, (reach.item, grasp)
    across = free_way(reach.arm, pick.object_away[-1], place.object_away[-1], carried, rng, deadline)
    back = free_way(reach.arm, place.hand_away[-1], reach.start, (with_it_there, 0.0, None), rng, deadline)
    if to_it is None or across is None or back is None:
        return None
    first = (
        ()
        if isinstance(to_it, bool)
        else (
            ("reach", *to_it, 0.0, False),
            ("approach", pick.hand_away[::-1], at_pick, opening, False),
            ("lift", pick.object_away, bare, grasp.width, True),
        )
    )
    held = held_limits(limits, ends.hold)
    com = grasp.object_tcp.inverse().act(reach.item.pose.undo(reach.item.com_in_world))
    ways = (
        *first,
        ("carry", *across, grasp.width, True),
        ("lower", place.object_away[::-1], bare, grasp.width, True),
        ("retreat", place.hand_away, at_place, opening, False),
        ("return", *back, 0.0, False),
    )
    phases = []
    for name, way, cell, wide, holding in ways:
        slow = held if holding else limits
        if name in ("approach", "lift", "lower", "retreat"):
            slow = gentle(slow)
        motions = timed(reach.arm, way, cell, com if holding else np.zeros(3), slow)
        phases.append(TransferPhase(name, tuple(motions), wide, holding))
    return tuple(phases)


def held_limits(limits: Limits, hold: float) -> Limits:
    """Limits of motions with something in the hand, whose grip withstands `hold`, m/s2."""
    return replace(limits, acceleration=min(limits.acceleration, _HOLD_SHARE * hold))


def gentle(limits: Limits) -> Limits:
    """Limits of the straight ways to and from an object."""
    return replace(limits, speed=min(limits.speed, _GENTLY))


def free_way(
    arm: Arm,
    start: Array,
    goal: Array,
    among: tuple[tuple[RigidObject, ...], float, tuple[RigidObject, Grasp] | None],
    rng: np.random.Generator,
    deadline: float,
) -> tuple[Array, Cell] | None:
    """A short way from start to goal, and the cell in which it is free: far from everything, or else as near as it may.

    Args:
        arm: at its place.
        start, goal: (J,).
        among: obstacles, opening of the fingers, and what is held.
        rng, deadline: see `find_way`.
    """
    bounds = arm.lower, arm.upper
    for margins in (_WIDE, (ROBOT_CLEARANCE, HELD_CLEARANCE)):
        cell = Cell(arm, *among, margins)
        if cell.free(start) and cell.free(goal):
            # The wide way may take half of the time that is left.
            until = (time.monotonic() + deadline) / 2 if margins is _WIDE else deadline
            way = find_way(start, goal, cell.free_between, bounds, rng, until)
            if way is not None:
                return shortened(way, cell.free_between, rng, deadline), cell
    return None
