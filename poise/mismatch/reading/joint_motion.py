"""From joint states, odometry and a wrench to a `RecordedMotion`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.mismatch.reading.kinematics import effort_track, recorded_from_motion
from poise.mismatch.reading.sanity import check_positions, check_rates
from poise.mismatch.recorded import EffortTrack, RecordedMotion
from poise.recording import JointStream, PoseStream, WrenchStream
from poise.robot import BaseMotion, ResampledSignal, RobotModel, base_motion_at, resample, sampling_times
from poise.simulation import JointMotion
from poise.types import Array, Mask, Stamps

_FEWEST = 100
"""Wrench samples with known motion, at least."""
_MARGIN = 0.1
"""s at the ends of the joint states whose efforts are not compared."""


def seconds_since(stamps: Stamps, start: int) -> Array:
    """(N,) s from `start`, ns, to each stamp."""
    return np.asarray((stamps - start) * 1e-9, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _JointSamples:
    """Finite joint states in the robot's order, (M, J) each, at (M,) s, and the odometry of the robot's base."""

    seconds: Array
    position: Array
    velocity: Array
    effort: Array
    odometry: PoseStream | None
    start: int

    def at(self, seconds: Array) -> tuple[ResampledSignal, BaseMotion | None, Mask]:
        """Joints and base at (N,) s, and the mask (N,) where both are known."""
        joints = resample(self.seconds, self.position, seconds, self.velocity)
        if self.odometry is None:
            return joints, None, joints.known
        base, known = base_motion_at(self.odometry, self.start, seconds)
        return joints, base, joints.known & known


def recorded_from_streams(
    robot: RobotModel,
    joints: JointStream,
    odometry: PoseStream | None,
    wrench: WrenchStream,
    phi: Array,
    gravity: float,
    tool: ArrayLike = 0.0,
) -> tuple[RecordedMotion, list[str]]:
    """The motion from streams, with sentences on losses and corrections.

    Args:
        robot: with a floating base when there is odometry.
        joints, odometry, wrench: as measured.
        phi: (10,) payload about the sensor's origin, sensor axes.
        gravity: m/s2, downwards.
        tool: (10,) links beyond the sensor that the wrench contains; the robot's joint efforts contain them always.

    Raises:
        InputError: BAD_INPUT, JOINT_MISSING, TOO_FEW_SAMPLES, EMPTY.
    """
    position, velocity, effort = robot.order(joints.names, joints.position, joints.velocity, joints.effort)
    check_positions(robot, position)
    check_rates(joints, wrench)
    finite = np.isfinite(position).all(axis=1)
    notes = [] if finite.all() else [f"{int((~finite).sum())} joint states are not finite and were left out"]
    start = int(wrench.stamps[0])
    sampled = seconds_since(joints.stamps[finite], start)
    samples = _JointSamples(sampled, position[finite], velocity[finite], effort[finite], odometry, start)
    seconds = sampling_times(seconds_since(wrench.stamps, start), wrench.wrench_in_sensor)[0]
    moved, base, known = samples.at(seconds)
    if known.sum() < _FEWEST:
        raise _no_overlap(int(known.sum()), sampled)
    if not known.all():
        notes.append(f"{int((~known).sum())} wrench samples have no joint motion around them and were left out")
    if moved.jitter > 0:
        notes.append(f"joint stamps jitter by {1e3 * moved.jitter:.2f} ms about a regular clock: that clock was used")
    track, carried = _efforts(robot, samples, phi, gravity), phi + np.asarray(tool)
    measured, moving = wrench.wrench_in_sensor[known], _base_where(base, known)
    motion = _where(moved, known)
    recorded = recorded_from_motion(
        robot, seconds[known], motion, carried, measured, base=moving, gravity=gravity, start=start, effort=track
    )
    return recorded, notes


def _no_overlap(count: int, sampled: Array) -> InputError:
    return InputError(
        ErrorCode.EMPTY,
        f"wrench and joint states overlap in {count} samples only: are their clocks the same? "
        f"joint states run from {sampled[0]:.3f} s to {sampled[-1]:.3f} s after the first wrench",
    )


def _efforts(robot: RobotModel, samples: _JointSamples, phi: Array, gravity: float) -> EffortTrack | None:
    """Efforts at the stamps of the joint states where all motion is known; None without measured efforts."""
    if not np.isfinite(samples.effort).all(axis=0).any():
        return None
    inner = (samples.seconds > samples.seconds[0] + _MARGIN) & (samples.seconds < samples.seconds[-1] - _MARGIN)
    at = samples.seconds[inner]
    moved, base, known = samples.at(at)
    joints = _where(moved, known)
    measured, moving = samples.effort[inner][known], _base_where(base, known)
    track = effort_track(robot, at[known], joints, measured, phi, moving, gravity=gravity)
    return track if track.names else None


def _where(moved: ResampledSignal, known: Mask) -> JointMotion:
    return JointMotion(moved.position[known], moved.velocity[known], moved.acceleration[known])


def _base_where(base: BaseMotion | None, known: Mask) -> BaseMotion | None:
    return None if base is None else BaseMotion(*(value[known] for value in vars(base).values()))
