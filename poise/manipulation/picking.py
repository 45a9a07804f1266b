"""Pick alone: a grasp where the object lies, the motions to it and up with it, and the way to put it back."""

import time
from dataclasses import dataclass, replace

import numpy as np

from poise.assembly import Analysis, RigidObject
from poise.assembly.statics import unstable
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.manipulation.arm import Arm
from poise.manipulation.carrying import ROOMY, TransferPhase, free_way, gentle, held_limits
from poise.manipulation.cell import Cell
from poise.manipulation.execution import TransferStep, steps_of_phases
from poise.manipulation.hand import Grasp
from poise.manipulation.reach import NARROW, End, Reach
from poise.manipulation.stopping import with_stops
from poise.manipulation.timing import Limits, timed
from poise.types import Array

_GRASPS = 4
"""Grasps for which a way is looked for before it is given up."""
_APART, _TURNED = 0.015, np.radians(30.0)
"""m and rad between grasps that are two."""


@dataclass(frozen=True, eq=False)
class Pick:
    """How an object gets into the hand.

    Args:
        grasp: of the object.
        end: the arm at the grasp.
        hold: m/s2 that the grip withstands with `mass`, kg.
        reach, lift, back, undo: phases to above the object; to it, and up with it; to where the arm began, holding it;
            and down again, opening, and up without it, instead.
        seconds: of planning.
    """

    grasp: Grasp
    end: End
    hold: float
    mass: float
    reach: tuple[TransferPhase, ...]
    lift: tuple[TransferPhase, ...]
    back: tuple[TransferPhase, ...]
    undo: tuple[TransferPhase, ...]
    seconds: float


@dataclass(frozen=True)
class PickSteps:
    """The steps of the phases of a pick; see `Pick`."""

    reach: tuple[TransferStep, ...]
    lift: tuple[TransferStep, ...]
    back: tuple[TransferStep, ...]
    undo: tuple[TransferStep, ...]


def pick_steps(pick: Pick, item: RigidObject, arm: Arm, speed: float) -> PickSteps:
    """What a pick takes, with a stop for every instant of each motion.

    Args:
        pick: the plan.
        item: that is picked, where it lies.
        arm: that does it.
        speed: m/s of the tool, at most.
    """
    point = pick.grasp.object_tcp.inverse().act(item.pose.undo(item.com_in_world))

    def steps(phases: tuple[TransferPhase, ...], names: tuple[TransferPhase, ...]) -> tuple[TransferStep, ...]:
        wanted = {phase.name for phase in names}
        found = [step for step in steps_of_phases(phases, pick.hold, speed) if step.name in wanted]
        return with_stops(found, arm, point, pick.hold)

    forth = (*pick.reach, *pick.lift, *pick.back)
    # What is held already is not grasped again: the steps follow those of the lift.
    undo = steps((*pick.lift, *pick.undo), pick.undo)
    return PickSteps(steps(forth, pick.reach), steps(forth, pick.lift), steps(forth, pick.back), undo)


def without_held(analysis: Analysis, name: str) -> Analysis:
    """The assembly without an object that is to be picked up.

    Raises:
        InputError: OBJECT_UNKNOWN, BAD_INPUT for a fixed one.
        NoAnswerError: UNSTABLE when something rests on it.
    """
    if analysis.assembly.objects[analysis.assembly.place_of(name)].fixed:
        raise InputError(ErrorCode.BAD_INPUT, f"object {name} is fixed: it cannot be picked up", object=name)
    rest = analysis.without(name)
    before, after = analysis.stability(), rest.stability()
    falls = [one for one in after.falling if one not in before.falling]
    if falls:
        error = unstable(falls, after.margin)
        what = f"without {name}, {', '.join(falls[:5])} would fall: pick that up first"
        raise NoAnswerError(ErrorCode.UNSTABLE, what, **error.data)
    return rest


def plan_pick(
    reach: Reach,
    limits: Limits = Limits(),  # noqa: B008
    seconds: float = 10.0,
    seed: int = 0,
    tried: tuple[Grasp, ...] = (),
) -> Pick:
    """Plan how the arm takes an object from where it lies.

    Args:
        reach: of the object, where it lies; what it begins with is where the arm ends.
        limits: of the motions; what the grip withstands limits them further while it holds.
        seconds: for looking for ways.
        seed: same seed, same motion (unless time runs out).
        tried: grasps that shall not be used again.

    Raises:
        NoAnswerError: UNREACHABLE, with data `step`: grasping or motion.
    """
    reach.require_pick()
    begun, number = time.monotonic(), 0
    for margins in (ROOMY, NARROW):
        for grasp, hold, end in reach.picks(margins):
            if any(_alike(grasp, other) for other in tried):
                continue
            number += 1
            planned = _planned(reach, grasp, hold, end, limits, begun, begun + seconds, seed)
            if planned is not None:
                return planned
            if number >= _GRASPS or time.monotonic() > begun + seconds:
                break
    step = "motion" if number else "grasping"
    why = f"no free way was found for {number} grasps" if number else "no other grasp can be reached"
    raise NoAnswerError(ErrorCode.UNREACHABLE, f"{reach.item.id}: {why}; make room, or move the arm", step=step)


def _planned(
    reach: Reach, grasp: Grasp, hold: float, end: End, limits: Limits, begun: float, deadline: float, seed: int
) -> Pick | None:
    rng = np.random.default_rng(seed)
    item, arm = reach.item, reach.arm
    opening = arm.hand.opening(grasp.width)
    there = (*reach.around, item)
    to_it = free_way(reach.arm, reach.start, end.hand_away[-1], (there, 0.0, None), rng, deadline)
    if to_it is None:
        return None
    held = reach.around, grasp.width, (item, grasp)
    back = free_way(reach.arm, end.object_away[-1], reach.start, held, rng, deadline)
    if back is None:
        return None
    at_pick, bare = reach.open_cell(grasp, item), Cell(arm, reach.around, grasp.width)
    carrying = held_limits(limits, hold)
    com = grasp.object_tcp.inverse().act(item.pose.undo(item.com_in_world))

    def phase(name: str, way: Array, cell: Cell, wide: float, holding: bool, slow: Limits) -> TransferPhase:
        point = com if holding else np.zeros(3)
        return TransferPhase(name, tuple(timed(arm, way, cell, point, slow)), wide, holding)

    away, up, slow, slower = end.hand_away, end.object_away, gentle(limits), gentle(carrying)
    return Pick(
        grasp,
        end,
        hold,
        item.mass,
        (phase("reach", *to_it, 0.0, False, limits),),
        (
            phase("approach", away[::-1], at_pick, opening, False, slow),
            phase("lift", up, bare, grasp.width, True, slower),
        ),
        (phase("hold", *back, grasp.width, True, carrying),),
        (
            phase("lower", up[::-1], bare, grasp.width, True, slower),
            phase("retreat", away, at_pick, opening, False, slow),
        ),
        time.monotonic() - begun,
    )


def _alike(first: Grasp, second: Grasp) -> bool:
    """Whether two grasps are nearly the same."""
    between = first.object_tcp.actInv(second.object_tcp)
    turn = float(np.arccos(np.clip((np.trace(between.rotation) - 1) / 2, -1.0, 1.0)))
    return bool(np.linalg.norm(between.translation) < _APART and turn < _TURNED)


def heavier(item: RigidObject, sigmas: float = 1.0) -> RigidObject:
    """The object with a mass that it hardly exceeds, by its covariance: what a grip is chosen for."""
    if item.covariance is None:
        return item
    more = item.mass + sigmas * float(np.sqrt(max(item.covariance[0, 0], 0.0)))
    inertia = None if item.inertia is None else item.inertia * (more / item.mass)
    return replace(item, mass=more, inertia=inertia)
