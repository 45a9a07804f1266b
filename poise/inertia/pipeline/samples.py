"""The samples of a recording: every wrench with the motion at its stamp, why it is not used, and the noise of both."""

from dataclasses import dataclass, replace

import numpy as np

from poise.errors import InputError, NoAnswerError
from poise.inertia.bayes import NOT_FINITE, OUT_OF_ORDER, SATURATED
from poise.inertia.estimators import InformationAccumulator, model_matrix, solve
from poise.inertia.model import NoiseLevels
from poise.recording import WrenchStream
from poise.robot import (
    NO_KINEMATICS,
    USED,
    FrameSource,
    Imu,
    JointSource,
    Kinematics,
    MotionSource,
    PairingReasons,
    PairingSettings,
    SensorMotion,
    SmoothedMotion,
    StaticPoseBuffer,
    scatter,
)
from poise.types import Array, Mask, Progress, Stamps

CHUNKS = 20
"""A recording is worked on in this many pieces, so that progress shows."""

ENOUGH = 10
"""Samples of which least squares leave something to judge by."""

JUDGED = 10_000_000_000
"""ns of motion that tell its noise."""

LEAST_NOISE = NoiseLevels(force=2e-3, torque=1e-4, linear_acceleration=1e-3, angular_acceleration=1e-3)
"""No sensor is better, and no model either."""

UNKNOWN_NOISE = NoiseLevels()
"""Where too few samples tell."""


@dataclass(frozen=True, eq=False)
class RecordedSamples:
    """What a recording says, sample by sample, where the motion and the wrench are known.

    Args:
        stamps: (N,) int64 ns, increasing.
        wrench: (N, 6) N and N m.
        motion: at these stamps.
        reasons: (N,) why a sample cannot be used; empty: it can.
        lost: stamps (M,) and reasons (M,) of the other samples.
        noise: of the samples, without any knowledge of the bias.
        gravity: (3,) m/s2 in the world.
        source: of the motion, in words.
        frame_id: the sensor frame.
    """

    stamps: Stamps
    wrench: Array
    motion: SensorMotion
    reasons: PairingReasons
    lost: tuple[Stamps, PairingReasons]
    noise: NoiseLevels
    gravity: Array
    source: str
    frame_id: str

    @property
    def used(self) -> Mask:
        """(N,) bool."""
        return np.asarray(self.reasons == USED)

    @property
    def matrix(self) -> Array:
        """(N, 6, 10) regressor."""
        return model_matrix(self.motion, self.gravity)


def collect(
    wrench: WrenchStream,
    kinematics: Kinematics,
    *,
    frame_id: str,
    gravity: float,
    saturation: tuple[float, float] = (np.inf, np.inf),
    settings: PairingSettings | None = None,
    imu: Imu | None = None,
    progress: Progress = lambda share: None,
) -> RecordedSamples:
    """Pair every wrench with the motion at its stamp: the smoothed motion where there is one, else held poses.

    Args:
        wrench: of the sensor.
        kinematics: of the sensor, not yet fed.
        frame_id: of the sensor.
        gravity: m/s2.
        saturation: force [N] and torque [N m] at which a channel counts as saturated.
        settings: how wrenches and motion are brought together.
        imu: knows the linear acceleration, where the kinematics do not.
        progress: is told how far it is.
    """
    stamps, values, down = wrench.stamps, wrench.wrench_in_sensor, np.array([0.0, 0.0, -gravity])
    motion, reasons, held = _paired(stamps, kinematics, settings or PairingSettings(), progress)
    noise, words = _motion_noise(kinematics.source), kinematics.source.words
    if imu is not None and not held.all():  # at rest there is no acceleration to be measured
        motion = _chosen(held, motion, imu.applied(motion, down))
        noise, words = replace(noise, linear_acceleration=imu.noise), f"{words}; {imu.words}"
    known = np.all([np.isfinite(getattr(motion, name)).all(axis=1) for name in _RATES], axis=0)
    reasons[~known & (reasons == USED)] = NO_KINEMATICS
    with np.errstate(invalid="ignore"):
        reasons[np.any(np.abs(values) >= np.repeat(saturation, 3), axis=1)] = SATURATED
    reasons[~np.isfinite(values).all(axis=1)] = NOT_FINITE
    reasons[np.diff(stamps, prepend=stamps[:1] - 1) <= 0] = OUT_OF_ORDER
    known &= ~np.isin(reasons, (NOT_FINITE, OUT_OF_ORDER))
    known &= np.isfinite(motion.rotation_world_sensor).all(axis=(1, 2))
    samples = RecordedSamples(
        stamps[known],
        values[known],
        motion.select(known),
        reasons[known],
        (stamps[~known], reasons[~known]),
        noise,
        down,
        words,
        frame_id,
    )
    return replace(samples, noise=_with_wrench_noise(samples))


_RATES = ("angular_velocity_in_sensor", "angular_acceleration_in_sensor", "linear_acceleration_in_sensor")


def _paired(
    stamps: Stamps, kinematics: Kinematics, settings: PairingSettings, progress: Progress
) -> tuple[SensorMotion, PairingReasons, Mask]:
    """Motion at stamps (N,), NaN where there is none; why; and where it is a pose held still."""
    moving, still = SmoothedMotion(kinematics.source, settings), StaticPoseBuffer(kinematics.source, settings)
    ends = [int(part[-1]) for part in np.array_split(stamps, CHUNKS) if len(part)]
    begin: int | None = None
    for number, end in enumerate([*ends[:-1], None]):
        kinematics.feed(begin, end)
        for track in (moving, still):
            track.update(flush=end is None)
        begin = end
        progress((number + 1) / max(len(ends), 1))
    motion, reasons = moving.pair(stamps)
    rest, at_rest = still.pair(stamps)
    held = (reasons != USED) & (at_rest == USED)
    reasons[held] = USED
    return _chosen(held, rest, motion), reasons, held


def _chosen(which: Mask, yes: SensorMotion, no: SensorMotion) -> SensorMotion:
    """Sample by sample the one motion or the other."""
    rates = [np.where(which[:, None], getattr(yes, name), getattr(no, name)) for name in _RATES]
    rotation = np.where(which[:, None, None], yes.rotation_world_sensor, no.rotation_world_sensor)
    return SensorMotion(yes.stamps, rotation, *rates)


def _motion_noise(source: MotionSource) -> NoiseLevels:
    """How noisy the accelerations are: what the smoothing says of the middle of the motion."""
    if not isinstance(source, JointSource | FrameSource) or source.newest is None:
        return UNKNOWN_NOISE
    stamps = source.stamps(-(2**62), source.newest)
    middle = int(stamps[len(stamps) // 2])
    try:
        measured = source.measured(middle - JUDGED // 2, middle + JUDGED // 2)
    except InputError:  # too few samples to differentiate: only held poses are used
        return LEAST_NOISE
    return replace(
        UNKNOWN_NOISE,
        linear_acceleration=_typical(measured.linear_acceleration_sigma, LEAST_NOISE.linear_acceleration),
        angular_acceleration=_typical(measured.angular_acceleration_sigma, LEAST_NOISE.angular_acceleration),
    )


def _typical(sigma: Array, least: float) -> float:
    return max(float(np.sqrt(np.median(sigma**2))), least)


def _with_wrench_noise(samples: RecordedSamples) -> NoiseLevels:
    """Noise of force and torque: how they zigzag, but no more than least squares leave; the bias may be any."""
    information, used = InformationAccumulator(), samples.used
    information.add(model_matrix(samples.motion.select(used), samples.gravity), samples.wrench[used])
    try:
        solution = solve(information)
        left = solution.residual_force, solution.residual_torque
    except NoAnswerError:  # then nothing is left to compare with
        left = np.nan, np.nan
    levels = {}
    for name, columns, most in (("force", slice(0, 3), left[0]), ("torque", slice(3, 6), left[1])):
        told = np.array([scatter(samples.wrench[used, columns]), most if used.sum() > ENOUGH else np.nan])
        usual, least = getattr(UNKNOWN_NOISE, name), getattr(LEAST_NOISE, name)
        levels[name] = max(float(np.nanmin(told)), least) if np.isfinite(told).any() else usual
    return replace(samples.noise, **levels, force_bias=np.inf, torque_bias=np.inf)
