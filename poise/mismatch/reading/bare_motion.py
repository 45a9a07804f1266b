"""A recording without any model of its robot: joint motion, efforts and the wrench, with nothing predicted."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.reading.commands import command_track
from poise.mismatch.reading.joint_motion import seconds_since
from poise.mismatch.reading.joint_samples import compared_efforts
from poise.mismatch.reading.measured_streams import MeasuredStreams
from poise.mismatch.reading.wrench_samples import usable
from poise.mismatch.recorded import EffortTrack, JointTrack, RecordedMotion
from poise.recording import JointStream
from poise.robot import resample
from poise.types import Array

_FEWEST = 100
"""Joint states, at least."""


def bare_motion(streams: MeasuredStreams, joints: JointStream) -> RecordedMotion:
    """The motion of a recording as its joints alone show it; every prediction is zero.

    Args:
        streams: of the recording.
        joints: its states, of all joints.

    Raises:
        InputError: TOO_FEW_SAMPLES; as `usable`.
    """
    joints = joints.select(np.isfinite(joints.position).all(axis=1))
    if len(joints) < _FEWEST:
        raise InputError(ErrorCode.TOO_FEW_SAMPLES, f"{streams.name}: {len(joints)} joint states are too few")
    wrench = None if streams.wrench is None else usable(streams.wrench)[0]
    start = int((joints if wrench is None else wrench).stamps[0])
    seconds = seconds_since(joints.stamps, start)
    effort = _efforts(joints, seconds)
    wanted = seconds if wrench is None else seconds_since(wrench.stamps, start)
    if wrench is None and effort is not None:
        wanted = effort.seconds
    moved = resample(seconds, np.asarray(joints.position, dtype=np.float64), wanted)
    known = moved.known
    count, number = int(known.sum()), len(joints.names)
    measured = np.full((count, 6), np.nan) if wrench is None else wrench.wrench_in_sensor[known]
    flat = np.zeros((count, 3))
    commands, end = streams.commands, int(joints.stamps[-1])
    return RecordedMotion(
        start=start,
        seconds=wanted[known],
        wrench=measured,
        phi=np.zeros(10),
        prediction=np.zeros((count, 6)),
        gravity=flat,
        linear_acceleration=flat,
        angular_velocity=flat,
        angular_acceleration=flat,
        rotation_world_sensor=np.broadcast_to(np.eye(3), (count, 3, 3)),
        position_in_world=flat,
        velocity_in_world=flat,
        joints=JointTrack(
            joints.names,
            moved.position[known],
            moved.velocity[known],
            moved.acceleration[known],
            np.zeros((count, 6, number)),
            np.zeros((count, 9, number)),
        ),
        effort=effort,
        commands=None if commands is None else command_track(commands, joints.names, start, end),
    )


def _efforts(joints: JointStream, seconds: Array) -> EffortTrack | None:
    """The measured efforts that change, at the stamps that are compared."""
    at, effort = compared_efforts(seconds, np.asarray(joints.effort, dtype=np.float64))
    if not len(at):
        return None
    there = np.isfinite(effort).all(axis=0) & (np.ptp(effort, axis=0) > 0.0)
    if not there.any():
        return None
    moved = resample(seconds, np.asarray(joints.position, dtype=np.float64), at)
    known = moved.known
    names = tuple(name for name, used in zip(joints.names, there.tolist(), strict=True) if used)
    parts = (each[known][:, there] for each in (moved.position, moved.velocity, moved.acceleration))
    zero = np.zeros((int(known.sum()), len(names)))
    square = np.zeros((*zero.shape, len(names)))
    position, velocity, acceleration = parts
    measured = effort[known][:, there]
    return EffortTrack(at[known], names, position, velocity, acceleration, measured, zero, zero, square, square)
