"""Calibration errors of every real robot: of payload, sensor, joints and clock, inside the declared tolerances.

They are fitted under every hypothesis with tight priors, so that no hypothesis wins by correcting them. A
calibration effect (`widens`) has these columns with a wide prior: it wins where the data contradict the tolerance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from poise.inertia.model import InertialParameters, about_com_jacobian, regressor
from poise.mismatch.effects import joint_columns, rotation_columns
from poise.mismatch.reading import Tolerance
from poise.mismatch.recorded import RecordedMotion, at_times
from poise.types import Array

PRIOR_SIGMA = 0.5
"""One sigma of the prior in units of the tolerance: the tolerance is two sigma."""

_CROSS = 0.1
"""Gain across axes (within force, within torque) in units of that along them: typical after calibration."""


@dataclass(frozen=True)
class CalibrationGroup:
    """A group of calibration errors.

    Args:
        name: payload, bias, drift, gain, rotation, joints, clock, or blur (no tolerance: see `_BLURS`).
        columns: (N, 6, k) response to one tolerance of each.
        sigma: (k,) prior, in units of the tolerance.
    """

    name: str
    columns: Array
    sigma: Array


_BLURS = (0.02, 0.05, 0.12)
"""s: faster parts of the prediction may be encoder noise, differentiated twice. Smoothing it without delay is no
physics; without these columns an oscillating part would win by filtering the noise."""

_TORQUE_CONSTANT = 0.01
"""Relative tolerance of the motors' torque constants."""


def calibration(recorded: RecordedMotion, tolerance: Tolerance) -> tuple[CalibrationGroup, ...]:
    """All groups for a recording; the wrench that gain, rotation and clock act on is `recorded.prediction`."""
    wrench = recorded.prediction
    middle = (recorded.seconds[0] + recorded.seconds[-1]) / 2
    ramp = (recorded.seconds - middle) / max(recorded.duration, 1e-9)
    bias = np.repeat([tolerance.bias_force, tolerance.bias_torque], 3)
    drift = np.repeat([tolerance.drift_force, tolerance.drift_torque], 3)
    late = -np.gradient(wrench, recorded.seconds, axis=0)[:, :, None]
    widths = [width / recorded.period for width in _BLURS]
    calm = [gaussian_filter1d(recorded.nominal, width, axis=0, mode="nearest") - recorded.nominal for width in widths]
    groups = [
        ("payload", payload_columns(recorded, tolerance)),
        ("bias", np.broadcast_to(np.diag(bias), (len(recorded), 6, 6))),
        ("drift", ramp[:, None, None] * np.diag(drift)),
        ("gain", gain_columns(wrench) * tolerance.sensor_gain),
        ("rotation", rotation_columns(wrench) * tolerance.sensor_rotation),
        ("joints", joint_columns(recorded) * tolerance.joint_offset),
        ("clock", late * tolerance.clock_offset),
        ("blur", np.stack(calm, axis=2)),
    ]
    return tuple(CalibrationGroup(name, columns, np.full(columns.shape[2], PRIOR_SIGMA)) for name, columns in groups)


def effort_calibration(recorded: RecordedMotion, tolerance: Tolerance) -> tuple[CalibrationGroup, ...]:
    """Calibration errors of joint efforts: payload, joint offsets, torque constants; (M, J, k) columns."""
    track, joints = recorded.effort, recorded.joints
    if track is None or joints is None:
        return ()
    chosen = [joints.names.index(name) for name in track.names]
    # A wrench on the sensor needs the opposite effort of the joints: tau = -J^T w.
    felt = payload_columns(recorded, tolerance)
    along = -np.einsum("ncj,nck->njk", joints.jacobian_in_sensor[:, :, chosen], felt)
    count = len(chosen)
    payload = at_times(recorded.seconds, along.reshape(len(recorded), -1), track.seconds).reshape(-1, count, 10)
    gain = track.rigid[:, :, None] * np.eye(count) * _TORQUE_CONSTANT
    groups = [
        ("payload", payload),
        ("joints", track.by_position * tolerance.joint_offset),
        ("gain", gain),
    ]
    return tuple(CalibrationGroup(name, columns, np.full(columns.shape[2], PRIOR_SIGMA)) for name, columns in groups)


def gain_columns(wrench: Array) -> Array:
    """(N, 6, 18) response to the gains of the six axes, and to the twelve across axes in units of `_CROSS`."""
    out = np.zeros((len(wrench), 6, 18))
    out[:, range(6), range(6)] = wrench
    across = [(i, j) for i in range(6) for j in range(6) if i != j and i // 3 == j // 3]
    for column, (i, j) in enumerate(across, start=6):
        out[:, i, column] = _CROSS * wrench[:, j]
    return out


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
