"""Calibration errors of every real robot: of payload, sensor, base, joints and clock, inside the declared tolerances.

Every hypothesis includes them. Each is uniform inside plus and minus its tolerance, and independent of the others, so
that no hypothesis wins by correcting them, up to the edges of all at once. A calibration effect (`widens`) has these
columns without the bounds: it wins where the data contradict the tolerance.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import eval_legendre

from poise.inertia.model import InertialParameters, about_com_jacobian, regressor
from poise.mismatch.effects import GAIN_LEVER, joint_columns, rotation_columns, tilt_columns
from poise.mismatch.inference.reversals import friction_known, reversal_columns
from poise.mismatch.reading import Tolerance
from poise.mismatch.recorded import EffortTrack, RecordedMotion, at_times, joint_torques, smoothing
from poise.types import Array, Mask

CALIBRATION_BOUND = 1.1
"""Half-width of the uniform priors in tolerances: the columns are linear, and the products of two errors at their edges
are up to a tenth of a tolerance."""
_WIDENED = 30.0
"""Factor on the bounds of errors that exceed their tolerances."""
NORMAL_PRECISION = 4.0
"""Of the coefficients of a group without bounds."""


@dataclass(frozen=True)
class CalibrationGroup:
    """A group of calibration errors.

    Args:
        name: payload, bias, drift, curved_drift (see `_TURNS`), scale, crosstalk, rotation, tilt, joints, clock,
            offset, links, gain (of motors), rest (what the model leaves of the wrench, as efforts), reversals (no
            tolerance: see `reversal_columns`), or blur (see `_BLURS`).
        values: (N, C, k) response to one tolerance of each; or (N, k), of errors that act in one channel each.
        bound: half-width of the uniform prior in tolerances, or (k,) of them; infinite: normal, `NORMAL_PRECISION`.
        channel: (k,) the channels of such errors, of `channels`; None: the errors act in all channels.
        channels: C.
        lasting: the group is the same for all predictions.
    """

    name: str
    values: Array
    bound: float | Array = CALIBRATION_BOUND
    channel: NDArray[np.intp] | None = None
    channels: int = 0
    lasting: bool = False

    @cached_property
    def widened(self) -> "CalibrationGroup":
        """The errors of which another signal shows that they exceed their tolerances."""
        return replace(self, bound=_WIDENED * self.bound)

    @property
    def columns(self) -> Array:
        """(N, C, k) response to one tolerance of each."""
        if self.channel is None:
            return self.values
        return np.asarray(self.values[:, None, :] * (np.arange(self.channels)[:, None] == self.channel))

    @cached_property
    def seen(self) -> Mask:
        """(k,) which errors have a response."""
        return np.asarray(self.values.any(axis=tuple(range(self.values.ndim - 1))))

    @property
    def alone(self) -> NDArray[np.intp]:
        """(k,) the channel in which an error acts alone, -1 where it acts in all."""
        return np.full(self.values.shape[-1], -1) if self.channel is None else self.channel

    @property
    def bounds(self) -> Array:
        """(k,) half-widths of the priors."""
        return np.full(self.values.shape[-1], self.bound)

    def response(self, coefficients: Array) -> Array:
        """(N, C) for coefficients (k,) in tolerances."""
        if self.channel is None:
            return np.asarray(self.values @ coefficients)
        return np.asarray(self.values @ (coefficients[:, None] * (self.channel[:, None] == np.arange(self.channels))))


_TURNS = 2
"""A sensor that warms up does not drift along a straight line. Inside its tolerance, the drift is a smooth curve with
as many turning points at most; without these columns its curvature would be physics outside the library."""
_BLURS = (0.006, 0.02, 0.05, 0.12)
"""s: faster parts of the prediction may be encoder noise, differentiated twice. Smoothing it without delay is no
physics; without these columns an oscillating part would win by filtering the noise. The narrowest one also has the
second-order part of a clock offset, which the clock's column lacks."""
_EFFORT_BLURS = (0.006, 0.02)
"""s, of joint efforts; a wider one, taken away from the inertia of a single joint, is that of a rotor or a load."""


def calibration(recorded: RecordedMotion, tolerance: Tolerance) -> tuple[CalibrationGroup, ...]:
    """All groups for a recording; the wrench that gain, rotation and clock act on is `recorded.prediction`."""
    wrench = recorded.prediction
    payload, *zeros, tilt, joints = recorded.once(("calibration", tolerance), lambda: _of_motion(recorded, tolerance))
    return (
        payload,
        *zeros,
        *_gains(wrench, tolerance.sensor_gain),
        CalibrationGroup("rotation", rotation_columns(wrench) * tolerance.sensor_rotation),
        tilt,
        joints,
        CalibrationGroup("clock", _clock(recorded.seconds, wrench, tolerance.clock_offset)),
        recorded.once("blur", lambda: _blur(recorded)) if recorded.lag == 0.0 else _blur(recorded),
    )


def _clock(seconds: Array, values: Array, late: float) -> Array:
    """(N, C, 1) change of values (N, C) that are this late, s."""
    later, sooner = (at_times(seconds, values, seconds + shift) for shift in (late, -late))
    return np.asarray((sooner - later)[:, :, None] / 2)


def _blur(recorded: RecordedMotion) -> CalibrationGroup:
    """What smoothing does to the nominal wrench, where the sensor reads it: as late as the prediction."""
    wrench = recorded.nominal
    if recorded.lag:
        wrench = at_times(recorded.seconds, wrench, recorded.seconds - recorded.lag)
    return CalibrationGroup("blur", smoothing(wrench, recorded.period, _BLURS), np.inf, lasting=recorded.lag == 0.0)


def _of_motion(recorded: RecordedMotion, tolerance: Tolerance) -> tuple[CalibrationGroup, ...]:
    """The groups that do not depend on what is predicted: payload, bias, drift, curved_drift, tilt, joints."""
    middle = (recorded.seconds[0] + recorded.seconds[-1]) / 2
    ramp = (recorded.seconds - middle) / max(recorded.duration, 1e-9)
    # Legendre polynomials with a range of one, as the ramp has.
    curved = eval_legendre(np.arange(2, _TURNS + 2), 2.0 * ramp[:, None])
    curved /= np.ptp(curved, axis=0)
    bias = np.repeat([tolerance.bias_force, tolerance.bias_torque], 3)
    drift = np.repeat([tolerance.drift_force, tolerance.drift_torque], 3)
    steady = np.broadcast_to(bias, (len(recorded), 6))
    # The drift is about the middle of the recording; a sensor may be inside its bias at the start or at the end alone.
    anywhere = CALIBRATION_BOUND + 0.5 * drift / np.maximum(bias, 1e-9)
    each = np.arange(6)
    return (
        CalibrationGroup("payload", payload_columns(recorded, tolerance), lasting=True),
        CalibrationGroup("bias", steady, anywhere, channel=each, channels=6, lasting=True),
        CalibrationGroup("drift", ramp[:, None] * drift, channel=each, channels=6, lasting=True),
        CalibrationGroup(
            "curved_drift",
            np.repeat(curved, 6, axis=1) * np.tile(drift, _TURNS),
            channel=np.tile(each, _TURNS),
            channels=6,
            lasting=True,
        ),
        CalibrationGroup("tilt", tilt_columns(recorded) * tolerance.base_tilt, lasting=True),
        CalibrationGroup("joints", joint_columns(recorded) * tolerance.joint_offset, lasting=True),
    )


def effort_calibration(recorded: RecordedMotion, tolerance: Tolerance) -> tuple[CalibrationGroup, ...]:
    """Calibration errors of joint efforts: payload, joint offsets, motors, links, base; (M, J, k) columns."""
    track, joints = recorded.effort, recorded.joints
    if track is None or joints is None:
        return ()
    # Of the residual that the nominal model leaves: it is asked for before those of other models.
    payload, *of_joints = recorded.once(
        ("effort calibration", tolerance), lambda: _of_efforts(recorded, track, tolerance)
    )
    each = np.arange(len(track.names))
    gain = CalibrationGroup("gain", track.prediction * tolerance.motor_gain, channel=each, channels=len(each))
    return (payload, gain, *of_joints)


def _of_efforts(recorded: RecordedMotion, track: EffortTrack, tolerance: Tolerance) -> tuple[CalibrationGroup, ...]:
    """The groups that do not depend on what is predicted; the payload's first."""
    payload = joint_torques(recorded, payload_columns(recorded, tolerance))
    offset = np.broadcast_to(track.sizes * tolerance.effort_offset, track.measured.shape)
    each = np.arange(len(track.names))
    none = np.zeros((*track.measured.shape, 0))
    links = none if track.links is None else track.links.efforts
    tilted = track.by_tilt(float(np.linalg.norm(recorded.gravity[0])))
    tilt = none if tilted is None else tilted
    rest = () if track.by_rest is None else (CalibrationGroup("rest", track.by_rest[:, :, None], lasting=True),)
    return (
        CalibrationGroup("payload", payload, lasting=True),
        CalibrationGroup("joints", track.by_position * tolerance.joint_offset, lasting=True),
        CalibrationGroup("offset", offset, channel=each, channels=len(each), lasting=True),
        CalibrationGroup("links", links * tolerance.link_mass, lasting=True),
        CalibrationGroup("tilt", tilt * tolerance.base_tilt, lasting=True),
        CalibrationGroup("clock", _late(track, tolerance.clock_offset), lasting=True),
        CalibrationGroup("blur", smoothing(track.rigid, track.period, _EFFORT_BLURS), np.inf, lasting=True),
        *rest,
        *((_reversals(track),) if friction_known(track) else ()),
    )


def _late(track: EffortTrack, late: float) -> Array:
    """(M, J, 1) change of the rigid arm's efforts that are this late, s; zero where they are early rather than late.

    Efforts may pass a filter that the positions of the same message do not pass: late inertia looks like damping. The
    sign is that beside a constant, friction and a rotor in each joint.
    """
    late_efforts = _clock(track.seconds, track.prediction, late)[:, :, 0]
    agreement = 0.0
    for joint, efforts in enumerate(late_efforts.T):
        speed = track.velocity[:, joint]
        nuisance = [np.ones_like(speed), speed, np.sign(speed), track.acceleration[:, joint]]
        basis = np.linalg.qr(np.stack(nuisance, axis=1))[0]
        residual = track.measured[:, joint] - track.prediction[:, joint]
        residual -= basis @ (basis.T @ residual)
        agreement += float(efforts @ residual) / max(float(residual @ residual), 1e-300)
    return late_efforts[:, :, None] * (agreement > 0.0)


def _reversals(track: EffortTrack) -> CalibrationGroup:
    count = len(track.names)
    soft = reversal_columns(track)
    return CalibrationGroup("reversals", soft, np.inf, channel=np.arange(count), channels=count, lasting=True)


def _gains(wrench: Array, size: float) -> tuple[CalibrationGroup, CalibrationGroup]:
    """Responses to the gains of the six axes, and to the thirty across axes, of this size each.

    Gains from force to torque and back are scaled by `GAIN_LEVER`.
    """
    lever = np.repeat([1.0, GAIN_LEVER], 3)
    to, of = np.nonzero(~np.eye(6, dtype=bool))
    across = wrench[:, of] * (size * lever[to] / lever[of])
    return (
        CalibrationGroup("scale", wrench * size, channel=np.arange(6), channels=6),
        CalibrationGroup("crosstalk", across, channel=to, channels=6),
    )


def payload_columns(recorded: RecordedMotion, tolerance: Tolerance) -> Array:
    """(N, 6, 10) response to one tolerance of mass, centre of mass (3) and inertia about it (6).

    The mass varies for a fixed shape: the inertia is proportional to it.
    """
    matrix = regressor(recorded.specific, recorded.angular_velocity, recorded.angular_acceleration)
    return np.asarray(matrix @ payload_steps(recorded.phi, tolerance))


def payload_steps(phi: Array, tolerance: Tolerance) -> Array:
    """(10, 10) change of phi by one tolerance of each of mass, com and inertia about it; zero without a payload."""
    steps = np.zeros((10, 10))
    if abs(phi[0]) < 1e-6:
        return steps
    body = InertialParameters.from_phi(phi)
    steps[:, 0] = phi * tolerance.payload_mass
    # d(com, inertia about com) / d phi, inverted at constant mass.
    about = about_com_jacobian(phi)
    inverse = np.linalg.inv(about[:, 1:])
    steps[1:, 1:4] = inverse[:, :3] * tolerance.payload_com
    size = max(float(np.trace(body.inertia)) / 3, 1e-4 * float(phi[0]))
    steps[1:, 4:] = inverse[:, 3:] * tolerance.payload_inertia * size
    return steps
