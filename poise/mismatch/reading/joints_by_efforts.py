"""Input check of the joint positions against the joint efforts: directions and order."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.mismatch.reading.effort_errors import EffortComparison
from poise.mismatch.reading.joint_input import orders
from poise.mismatch.recorded import EffortTrack, RecordedMotion
from poise.robot import RobotModel, inertia_of, pinocchio_state
from poise.types import Array

_SAMPLES = 600
"""Samples of the recording that are compared."""
_UNEXPLAINED, _EXPLAINED, _BETTER = 0.25, 0.05, 0.2
"""Share of the variance of an effort that the recorded joints leave at some joint at least, others at each joint at
most; and the largest ratio of both."""


def check_joints_by_efforts(robot: RobotModel, recorded: RecordedMotion, name: str) -> None:
    """Refuse joint positions from which the efforts do not follow, where they do from those of other joints.

    The efforts of each model are compared beside offset, friction, rotor and a gain of each joint.

    Args:
        robot: of the description, on a base at rest.
        recorded: with the efforts of all its joints, as measured, and the load.
        name: of the recording.

    Raises:
        InputError: BAD_INPUT, with the joints.
    """
    track = recorded.effort
    if track is None or track.names != robot.joint_names or robot.base == "floating" or len(track.names) < 2:
        return
    count = len(track.seconds)
    track = track.select(np.arange(count) % max(count // _SAMPLES, 1) == 0)
    own = _left(track)
    if own < _UNEXPLAINED:
        return
    found = {sentence: _left(_moved(robot, recorded, track, *move)) for sentence, move in _others(track.names)}
    best = min(found, key=found.__getitem__)
    if found[best] <= min(_EXPLAINED, _BETTER * own):
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"{name}: the efforts do not follow from the joint positions; they would if {best}: correct the joint "
            "states, or the description of the robot",
        )


def _left(track: EffortTrack) -> float:
    """The largest share of the variance of a joint's effort that the motion leaves."""
    comparison = EffortComparison.of(track)
    return float(comparison.left(comparison.measured, comparison.bases(track.rigid)).max())


def _others(names: tuple[str, ...]) -> Iterator[tuple[str, tuple[NDArray[np.intp], Array]]]:
    """What a driver may have meant, in words: which column (J,) holds each joint, and its sign (J,)."""
    straight, count = np.ones(len(names)), np.arange(len(names))
    for j, name in enumerate(names):
        yield f"{name} counted in the opposite direction", (count, np.where(count == j, -1.0, 1.0))
    for sentence, order in orders(names):
        yield sentence, (order, straight)


def _moved(
    robot: RobotModel, recorded: RecordedMotion, track: EffortTrack, order: NDArray[np.intp], sign: Array
) -> EffortTrack:
    """The efforts with the motion of other joints, and what a rigid arm needs for it."""
    parts = (track.position, track.velocity, track.acceleration)
    position, velocity, acceleration = (sign * part[:, order] for part in parts)
    model = robot.pinocchio.copy()
    frame = model.frames[robot.frame_id(robot.sensor_frame)]
    model.inertias[frame.parentJoint] += frame.placement.act(inertia_of(recorded.phi))
    model.gravity.linear = np.array([0.0, 0.0, -float(np.linalg.norm(recorded.gravity[0]))])
    data, state = model.createData(), pinocchio_state(robot, position, velocity, acceleration)
    torque = np.array([pin.rnea(model, data, *each) for each in zip(state.q, state.v, state.a, strict=True)])
    rigid = torque @ robot.coupling
    return replace(track, position=position, velocity=velocity, acceleration=acceleration, rigid=rigid)
