"""Let an object that almost stands sink, quasi-statically, to where it does."""

from dataclasses import replace

import numpy as np

from poise.assembly import Analysis, RigidObject
from poise.assembly.statics import Mechanism
from poise.errors import InputError
from poise.geometry import Pose, rotation_about
from poise.types import Array

_MOST_STEPS = 25
_FIRST_STEP = 0.05
"""Largest motion of a step, in sizes of the object."""
_SMALLEST_STEP = 1e-4


def settle(analysis: Analysis, item: RigidObject, size: float) -> tuple[Analysis, RigidObject] | None:
    """Follow the motion that is nearest to happening until the assembly stands.

    Each step moves the object along the collapse mechanism of the equilibrium's dual (equilibrium.stability) as far as
    nothing is penetrated; the steps shrink. Only the object may move: when it would take others along, None.

    Args:
        analysis: of the assembly with the object in it.
        item: the object, as it is in there.
        size: m, of the object.
    """
    step = _FIRST_STEP
    for _ in range(_MOST_STEPS):
        twist = _falling(analysis, item)
        if twist is None:
            return None
        moved = None
        while moved is None and step >= _SMALLEST_STEP:
            moved = _moved(analysis, item, twist, step * size)
            step *= 0.5 if moved is None else 1.0
        if moved is None:
            return None
        analysis, item = moved
        if analysis.stability().margin > 0:
            return analysis, item
    return None


def _falling(analysis: Analysis, item: RigidObject) -> Array | None:
    """(6,) how the object falls; None when others fall too, or nothing does."""
    place = analysis.assembly.index[item.id]
    found = None
    for block in analysis.blocks:
        standing, _ = block.solvers.standing()
        if standing.margin <= 0:
            velocities = Mechanism(block, standing.twist).velocities
            if set(velocities) != {place}:
                return None
            found = velocities[place]
    return found


def _moved(analysis: Analysis, item: RigidObject, twist: Array, length: float) -> tuple[Analysis, RigidObject] | None:
    """The object moved along its twist so that no point moves farther than `length`; None when that penetrates."""
    com = item.com_in_world
    reach = float(np.linalg.norm(item.vertices - com, axis=1).max())
    speed = float(np.linalg.norm(twist[:3]) + reach * np.linalg.norm(twist[3:]))
    if speed <= 0:
        return None
    velocity, turning = twist[:3] * length / speed, twist[3:] * length / speed
    angle = float(np.linalg.norm(turning))
    turn = rotation_about(turning / angle, angle) if angle > 1e-12 else np.eye(3)
    pose = Pose(turn @ item.pose.rotation, turn @ (item.pose.translation - com) + com + velocity)
    there = replace(item, pose=pose)
    try:
        return analysis.with_object(there), there
    except InputError:
        return None
