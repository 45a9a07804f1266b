"""From joint states, odometry and a wrench to a `RecordedMotion`."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.mismatch.reading.joint_samples import apart, compared_efforts
from poise.mismatch.reading.kinematics import effort_track, recorded_from_motion
from poise.mismatch.reading.motion_variance import AccelerationSigma
from poise.mismatch.reading.sanity import check_positions, check_rates
from poise.mismatch.recorded import EffortTrack, RecordedMotion
from poise.recording import JointStream, PoseStream, WrenchStream
from poise.robot import BaseMotion, MeasuredBase, ResampledSignal, RobotModel, base_motion_at, resample, sampling_times
from poise.simulation import JointMotion
from poise.types import Array, Mask, Stamps

_FEWEST = 100
"""Wrench samples with known motion, at least."""
_JITTER = 1e-5
"""s of jitter that is neither removed nor reported."""
_MARGIN = 0.1
"""s at the ends of the joint states whose efforts are not compared."""


def seconds_since(stamps: Stamps, start: int) -> Array:
    """(N,) s from `start`, ns, to each stamp."""
    return np.asarray((stamps - start) * 1e-9, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _JointSamples:
    """Finite joint states in the robot's order, (M, J) each, at (M,) s, and the odometry of the robot's base.

    Where a regular clock explains the stamps, positions and efforts were sampled by it; `jitter` is theirs, s.
    """

    seconds: Array
    position: Array
    velocity: Array
    effort: Array
    odometry: PoseStream | None
    start: int
    jitter: float

    def at(self, seconds: Array) -> tuple[ResampledSignal, MeasuredBase | None, Mask]:
        """Joints and base at (N,) s, and the mask (N,) where both are known."""
        joints = resample(self.seconds, self.position, seconds, self.velocity)
        if self.odometry is None:
            return joints, None, joints.known
        base = base_motion_at(self.odometry, self.start, seconds)
        return joints, base, joints.known & base.known


def recorded_from_streams(
    robot: RobotModel,
    joints: JointStream,
    odometry: PoseStream | None,
    wrench: WrenchStream | None,
    phi: Array,
    gravity: float,
    tool: ArrayLike = 0.0,
) -> tuple[RecordedMotion, list[str]]:
    """The motion from streams, with sentences on losses and corrections.

    Args:
        robot: with a floating base when there is odometry.
        joints, odometry, wrench: as measured; without a wrench, the recording is at the stamps of the joint efforts.
        phi: (10,) payload about the sensor's origin, sensor axes.
        gravity: m/s2, downwards.
        tool: (10,) links beyond the sensor that the wrench contains; the robot's joint efforts contain them always.

    Raises:
        InputError: BAD_INPUT, JOINT_MISSING, TOO_FEW_SAMPLES, EMPTY.
    """
    position, velocity, effort = robot.order(joints.names, joints.position, joints.velocity, joints.effort)
    check_positions(robot, position)
    check_rates(joints, joints if wrench is None else wrench)
    start = int((joints if wrench is None else wrench).stamps[0])
    sampled, jitter = _clock(seconds_since(joints.stamps, start), position)
    sure = np.isfinite(sampled)
    samples = _JointSamples(sampled[sure], position[sure], velocity[sure], effort[sure], odometry, start, jitter)
    carried = phi + np.asarray(tool)
    if wrench is None:
        return _of_efforts(robot, samples, phi, carried, gravity)
    seconds = _wrench_times(wrench, start)
    notes = []
    moved, base, known = samples.at(seconds)
    if known.sum() < _FEWEST:
        raise _no_overlap(int(known.sum()), samples.seconds)
    if not known.all():
        notes.append(f"{int((~known).sum())} wrench samples have no joint motion around them and were left out")
    bursts = ~apart(seconds)
    if bursts.any():
        notes.append(f"{int(bursts.sum())} wrench samples were stamped with the ones before them and were left out")
        known &= ~bursts
    notes += _jitter(samples)
    found = _efforts(robot, samples, phi, gravity)
    track = None if found is None else found[0]
    moved, base = moved.select(known), base and base.select(known)
    motion, moving, errors = _parts(moved, base)
    measured, at = wrench.wrench_in_sensor[known], seconds[known]
    make = partial(recorded_from_motion, base=moving, gravity=gravity, start=start, effort=track, errors=errors)
    return make(robot, at, motion, carried, measured), notes


def _no_overlap(count: int, sampled: Array) -> InputError:
    return InputError(
        ErrorCode.EMPTY,
        f"wrench and joint states overlap in {count} samples only: are their clocks the same? "
        f"joint states run from {sampled[0]:.3f} s to {sampled[-1]:.3f} s after the first wrench",
    )


def _of_efforts(
    robot: RobotModel, samples: _JointSamples, phi: Array, carried: Array, gravity: float
) -> tuple[RecordedMotion, list[str]]:
    """The motion at the stamps of the joint efforts, or of the joint states, for a recording without a wrench."""
    found = _efforts(robot, samples, phi, gravity)
    if found is None:
        moved, base, known = samples.at(samples.seconds)
        track, seconds, moved, base = None, samples.seconds[known], moved.select(known), base and base.select(known)
    else:
        track, moved, base = found
        seconds = track.seconds
    if len(seconds) < _FEWEST:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"{len(seconds)} samples of joint states with a known motion are too few: record for ten seconds or more",
        )
    joints, moving, _ = _parts(moved, base)
    recorded = recorded_from_motion(
        robot, seconds, joints, carried, base=moving, gravity=gravity, start=samples.start, effort=track
    )
    return recorded, _jitter(samples)


def _wrench_times(wrench: WrenchStream, start: int) -> Array:
    """(N,) s, when wrenches were sampled: by a regular clock, or as their stamps say where it is not sure."""
    stamped = seconds_since(wrench.stamps, start)
    even = sampling_times(stamped, wrench.wrench_in_sensor)[0]
    return np.where(np.isfinite(even), even, stamped)


def _clock(stamped: Array, position: Array) -> tuple[Array, float]:
    """When joint states were sampled, and the jitter of their stamps, s; without jitter the stamps are kept."""
    even, jitter = sampling_times(stamped, position)
    return (stamped, 0.0) if jitter < _JITTER else (even, jitter)


def _jitter(samples: _JointSamples) -> list[str]:
    if not samples.jitter:
        return []
    return [f"joint stamps jitter by {1e3 * samples.jitter:.2f} ms about a regular clock: that clock was used"]


def _efforts(
    robot: RobotModel, samples: _JointSamples, phi: Array, gravity: float
) -> tuple[EffortTrack, ResampledSignal, MeasuredBase | None] | None:
    """Efforts where all motion is known, with that motion at their stamps; None without measured efforts."""
    inner = (samples.seconds > samples.seconds[0] + _MARGIN) & (samples.seconds < samples.seconds[-1] - _MARGIN)
    at, effort = compared_efforts(samples.seconds[inner], samples.effort[inner])
    if not len(at) or not np.isfinite(effort).any():
        return None
    moved, base, known = samples.at(at)
    moved, base = moved.select(known), base and base.select(known)
    joints, moving, errors = _parts(moved, base)
    track = effort_track(robot, at[known], joints, effort[known], phi, moving, gravity=gravity, errors=errors)
    return (track, moved, base) if track.names else None


def _parts(
    moved: ResampledSignal, base: MeasuredBase | None
) -> tuple[JointMotion, BaseMotion | None, AccelerationSigma]:
    joints = JointMotion(moved.position, moved.velocity, moved.acceleration)
    if base is None:
        return joints, None, AccelerationSigma(moved.sigma[2])
    return joints, base.motion, AccelerationSigma(moved.sigma[2], base.acceleration_sigma, base.place_noise)
