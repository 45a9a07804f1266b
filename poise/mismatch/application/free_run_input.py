"""A recording as the input of free runs: smoothed joint motion, commands, efforts and the wrench on one clock."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.reading import holds, recorded_commands, seconds_since
from poise.recording import JointStream, Recording
from poise.robot import resample
from poise.simulation.rollout import RecordedRun
from poise.types import Array

_FEWEST = 50
"""Joint states of a recording, at least."""


def recorded_run(recording: Recording) -> RecordedRun:
    """What of a recording a free run needs.

    Raises:
        InputError: TOPIC_MISSING without joint states; TOO_FEW_SAMPLES.
    """
    joints = recording.joint_states()
    measured = np.flatnonzero(np.isfinite(joints.position).any(axis=0))
    names = tuple(joints.names[column] for column in measured.tolist())
    rows = np.isfinite(joints.position[:, measured]).all(axis=1)
    if rows.sum() < _FEWEST:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES, f"{recording.path}: {int(rows.sum())} joint states are too few for a free run"
        )
    joints = joints.select(rows)
    start = int(joints.stamps[0])
    seconds = seconds_since(joints.stamps, start)
    position, velocity, effort = (each[:, measured] for each in (joints.position, joints.velocity, joints.effort))
    moved = resample(seconds, position, seconds, velocity)
    known = moved.known
    sent = recorded_commands(recording)
    felt = recording.wrench() if holds(recording, "wrench") else None
    return RecordedRun(
        names,
        seconds[known],
        moved.position[known],
        moved.velocity[known],
        velocity[known],
        effort[known],
        np.zeros(0) if sent is None else seconds_since(sent.stamps, start),
        *_commands(sent, names),
        None if felt is None else seconds_since(felt.stamps, start),
        None if felt is None else felt.wrench_in_sensor,
        None if felt is None else felt.frame_id,
    )


def _commands(sent: JointStream | None, names: tuple[str, ...]) -> tuple[Array, Array]:
    """(K, J) commanded positions and velocities of these joints; NaN where there are none."""
    if sent is None:
        return np.full((0, len(names)), np.nan), np.full((0, len(names)), np.nan)
    out = np.full((2, len(sent), len(names)), np.nan)
    for column, name in enumerate(names):
        if name in sent.names:
            at = sent.names.index(name)
            out[0, :, column], out[1, :, column] = sent.position[:, at], sent.velocity[:, at]
    return out[0], out[1]
