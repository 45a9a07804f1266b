"""From tf, and from an accelerometer if present, to a `RecordedMotion` without joints."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import nearest_rotation
from poise.mismatch.effects import SLOWEST_VIBRATION, slow_part
from poise.mismatch.reading.joint_motion import seconds_since
from poise.mismatch.reading.joint_samples import apart
from poise.mismatch.reading.motion_variance import wrench_variance
from poise.mismatch.recorded import RecordedMotion, at_times, load_wrench, rounding
from poise.recording import Recording, WrenchStream
from poise.robot import FrameSource, MeasuredMotion, find_imu, find_kinematics, scatter
from poise.types import Array

_ACCELEROMETER_GAP = 0.1
"""s by which an accelerometer may begin later than the wrench, or end earlier."""
_SOURCES = np.eye(6)[None]
"""(1, 6, 6) of `wrench_variance`: errors along the axes of the sensor."""


def recorded_from_frames(
    recording: Recording, frame: str, wrench: WrenchStream, phi: Array, gravity: float
) -> tuple[RecordedMotion, list[str]]:
    """The motion from the sensor's poses alone: accelerations from poses or from an accelerometer."""
    kinematics = find_kinematics(recording, frame)
    kinematics.feed(None, None)
    source, end = kinematics.source, kinematics.source.newest or 0
    found = source.measured(0, end) if isinstance(source, FrameSource) else None
    motion = source.motion(0, end) if found is None else found.motion
    start = int(wrench.stamps[0])
    sampled, seconds = seconds_since(motion.stamps, start), seconds_since(wrench.stamps, start)
    known = (seconds >= sampled[0]) & (seconds <= sampled[-1]) & apart(seconds)
    if known.sum() < 100:
        raise InputError(ErrorCode.EMPTY, f"{recording.path}: wrench and tf overlap in {int(known.sum())} samples only")
    seconds = seconds[known]

    def carried(values: Array) -> Array:
        return at_times(sampled, values.reshape(len(values), -1), seconds)

    rotation = nearest_rotation(carried(motion.rotation_world_sensor).reshape(-1, 3, 3))
    down = np.array([0.0, 0.0, -gravity]) @ rotation
    linear = carried(motion.linear_acceleration_in_sensor)
    omega, alpha = carried(motion.angular_velocity_in_sensor), carried(motion.angular_acceleration_in_sensor)
    felt, notes = _measured_acceleration(recording, frame, start, seconds, down), []
    if felt is not None and not kinematics.has_positions:
        linear = slow_part(seconds, felt)
        notes.append(
            f"tf has no positions: the part of the imu below {SLOWEST_VIBRATION:.0f} Hz is taken for the motion"
        )
    sigma = None if found is None else np.abs(carried(_acceleration_sigma(found, kinematics.has_positions)))
    poses = kinematics.source.poses(int(motion.stamps[0]), int(motion.stamps[-1]))
    place = at_times(seconds_since(poses.stamps, start), poses.translation, seconds)
    recorded = RecordedMotion(
        start=start,
        seconds=seconds,
        wrench=wrench.wrench_in_sensor[known],
        phi=phi,
        prediction=load_wrench(phi, down - linear, omega, alpha),
        gravity=down,
        linear_acceleration=linear,
        angular_velocity=omega,
        angular_acceleration=alpha,
        rotation_world_sensor=rotation,
        position_in_world=place,
        velocity_in_world=np.gradient(place, seconds, axis=0),
        accelerometer=felt,
        motion_variance=None if sigma is None else wrench_variance(phi, omega, _SOURCES, sigma),
        place_noise=_place_noise(poses.translation),
    )
    return recorded, notes


def _place_noise(places: Array) -> float:
    """m, one sigma of measured positions (M, 3): their scatter, or their rounding."""
    rounded, measured = rounding(places), scatter(places)
    return float(max(measured, rounded) if np.isfinite(measured) else rounded)


def _acceleration_sigma(found: MeasuredMotion, has_positions: bool) -> Array:
    """(M, 6) one-sigma errors of linear and angular acceleration; without positions the linear one is zero."""
    return np.hstack([found.linear_acceleration_sigma * has_positions, found.angular_acceleration_sigma])


def _measured_acceleration(recording: Recording, frame: str, start: int, seconds: Array, down: Array) -> Array | None:
    """(N, 3) acceleration by an accelerometer on the sensor, without its offset; None without one."""
    imu = find_imu(recording, frame)
    if imu is None:
        return None
    stamps = seconds_since(imu.stamps, start)
    if len(stamps) < 10 or stamps[0] > seconds[0] + _ACCELEROMETER_GAP or stamps[-1] < seconds[-1] - _ACCELEROMETER_GAP:
        return None
    # A wrench sample is an average over about its period: the acceleration is averaged likewise.
    period = float(np.median(np.diff(seconds)))
    parts = [at_times(stamps, imu.specific, seconds + shift * period) for shift in (-1 / 3, 0.0, 1 / 3)]
    felt = down - np.mean(parts, axis=0)
    return np.asarray(felt - felt.mean(axis=0))
