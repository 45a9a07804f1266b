"""The payload, identified from the recording when the model does not state it."""

from dataclasses import replace

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.inertia.model import regressor
from poise.mismatch.reading.nominal_model import Tolerance
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_SCALE = np.array([3.0, *[0.3] * 3, *[0.05] * 6, *[10.0] * 3, *[1.0] * 3])
"""One sigma of weak priors on mass, first moments, inertia and bias: unobservable ones stay small."""
_LOOSER = 10.0
_FARTHEST = 5.0
"""m from the sensor beyond which no centre of mass is plausible."""


def identified(recorded: RecordedMotion) -> Array:
    """(10,) the payload that explains the wrench best, beside a bias; robust (Huber weights, three rounds).

    Raises:
        InputError: BAD_INPUT when its mass comes out negative: the wrench has the opposite sign.
    """
    _check_units(recorded)
    matrix = regressor(recorded.specific, recorded.angular_velocity, recorded.angular_acceleration)
    rows = np.concatenate([matrix, np.tile(np.eye(6), (len(recorded), 1, 1))], axis=2)
    sigma = np.repeat([0.1, 0.005], 3)
    weight = np.ones((len(recorded), 6))
    answer = np.zeros(16)
    for _ in range(3):
        scaled = (rows * (np.sqrt(weight) / sigma)[:, :, None]).reshape(-1, 16)
        target = (recorded.wrench * np.sqrt(weight) / sigma).ravel()
        answer = np.linalg.solve(scaled.T @ scaled + np.diag(_SCALE**-2.0), scaled.T @ target)
        off = (recorded.wrench - rows @ answer) / sigma
        size = np.maximum(1.4826 * np.median(np.abs(off), axis=0), 1.0)
        weight = np.minimum(1.0, 2.0 * size / np.maximum(np.abs(off), 1e-9))
    if answer[0] < -0.1:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"the payload would weigh {answer[0]:.2f} kg: the wrench has the opposite sign; negate it, the contract is "
            "what the load exerts on the sensor",
        )
    return np.asarray(answer[:10])


def _check_units(recorded: RecordedMotion) -> None:
    """Refuse torques that imply an implausibly distant centre of mass; least squares for each unit separately."""
    matrix = regressor(recorded.specific, recorded.angular_velocity, recorded.angular_acceleration)
    mass = _slope(matrix[:, :3, :1], recorded.wrench[:, :3])[0]
    lever = _slope(matrix[:, 3:, 1:4], recorded.wrench[:, 3:]) / max(abs(float(mass)), 0.05)
    if float(np.linalg.norm(lever)) > _FARTHEST:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"the centre of mass would be {float(np.linalg.norm(lever)):.0f} m from the sensor: the torque seems to be "
            "in N mm; the contract is N m",
        )


def _slope(columns: Array, measured: Array) -> Array:
    """(k,) least squares of (N, 3) on (N, 3, k), beside a constant."""
    centred, wanted = columns - columns.mean(axis=0), measured - measured.mean(axis=0)
    normal = np.einsum("nck,ncl->kl", centred, centred)
    ridge = (1e-3 * float(np.trace(normal)) + 1e-9) * np.eye(len(normal))
    return np.asarray(np.linalg.solve(normal + ridge, np.einsum("nck,nc->k", centred, wanted)))


def loosened(tolerance: Tolerance) -> Tolerance:
    """Wider tolerances for a payload that a first fit identified."""
    return replace(
        tolerance,
        payload_mass=_LOOSER * tolerance.payload_mass,
        payload_com=_LOOSER * tolerance.payload_com,
        payload_inertia=_LOOSER * tolerance.payload_inertia,
    )
