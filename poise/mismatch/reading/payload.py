"""The payload, identified from the recording when the model does not state it."""

from dataclasses import replace

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.inertia.model import motion_signals, regressor
from poise.inertia.verdict import FitSamples
from poise.mismatch.reading.nominal_model import Tolerance
from poise.mismatch.reading.wrench_input import WrenchMoments
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array
from poise.weighing import find_causes

_SCALE = np.array([3.0, *[0.3] * 3, *[0.05] * 6, *[10.0] * 3, *[1.0] * 3])
"""One sigma of weak priors on mass, first moments, inertia and bias: unobservable ones stay small."""
_LOOSER = 10.0
_FARTHEST = 5.0
"""m from the sensor beyond which no centre of mass is plausible."""
_NO_LOAD, _UNEXPLAINED = 0.1, 0.3
"""kg of negative mass that errors of an empty hand may have, and the share of the variance of force or torque that a
payload leaves at least, for an error of the driver to be looked for."""
_CLEARLY = 30.0
"""Nats by which an error of the driver explains the wrench better; an empty hand reaches less by chance."""
_OF_THE_DRIVER = (
    ErrorCode.FORCE_SIGN,
    ErrorCode.TORQUE_SIGN,
    ErrorCode.LEFT_HANDED_AXES,
    ErrorCode.SENSOR_ROTATED,
    ErrorCode.WRONG_FRAME,
    ErrorCode.FORCE_UNIT,
    ErrorCode.TORQUE_UNIT,
    ErrorCode.CLOCK_LATE,
)


def identified(recorded: RecordedMotion) -> Array:
    """(10,) the payload that explains the wrench best, beside a bias; robust (Huber weights, three rounds).

    Raises:
        InputError: BAD_INPUT where no payload explains the wrench, but one does behind an error of the driver.
    """
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
    moments = WrenchMoments.of(recorded.wrench, rows @ answer)
    lever = _lever(recorded, matrix)
    if answer[0] < -_NO_LOAD or lever > _FARTHEST or moments.unexplained.max() > _UNEXPLAINED:
        _refuse(recorded, float(answer[0]), lever)
    return np.asarray(answer[:10])


def _refuse(recorded: RecordedMotion, mass: float, lever: float) -> None:
    """Refuse a wrench that an error of the driver explains, or that means an impossible payload."""
    samples = FitSamples(
        np.round((recorded.seconds - recorded.seconds[0]) * 1e9).astype(np.int64),
        np.ones(len(recorded)),
        recorded.rotation_world_sensor,
        motion_signals(recorded.specific, recorded.angular_velocity, recorded.angular_acceleration),
        recorded.wrench,
        recorded.rotation_world_sensor[0] @ recorded.gravity[0],
    )
    cause = next(iter(find_causes(samples)), None)
    if cause is not None and cause.certain and cause.gain > _CLEARLY and cause.code in _OF_THE_DRIVER:
        raise InputError(ErrorCode.BAD_INPUT, cause.sentence, cause=cause.code.name)
    what = f"weigh {mass:.2f} kg" if mass < -_NO_LOAD else f"have its centre of mass {lever:.0f} m from the sensor"
    if mass < -_NO_LOAD or lever > _FARTHEST:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"the payload would {what}: check the sign, the axes and the units of the wrench; the contract is what the "
            "load exerts on the sensor, in N and N m",
        )


def _lever(recorded: RecordedMotion, matrix: Array) -> float:
    """m from the sensor to the centre of mass, by least squares of force and torque alone."""
    mass = _slope(matrix[:, :3, :1], recorded.wrench[:, :3])[0]
    first = _slope(matrix[:, 3:, 1:4], recorded.wrench[:, 3:])
    return float(np.linalg.norm(first)) / max(abs(float(mass)), 0.05)


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
