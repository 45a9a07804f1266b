"""The variance of predicted wrenches and joint efforts by the errors of the measured accelerations."""

from dataclasses import dataclass

import numpy as np

from poise.geometry import cross
from poise.mismatch.recorded import motion_response
from poise.robot import BaseMotion
from poise.types import Array


@dataclass(frozen=True, eq=False)
class AccelerationSigma:
    """One-sigma errors of the accelerations of a motion, and of the places that they come from.

    Args:
        joints: (N, J) rad/s2 or m/s2.
        base: (N, 6) of the root link, linear and angular, base axes; None: the base rests.
        place: m, noise of the measured position of the base.
    """

    joints: Array
    base: Array | None = None
    place: float = 0.0


def wrench_variance(phi: Array, angular_velocity: Array, sources: Array, sigma: Array) -> Array:
    """(N, 6) variance of the wrench of a load by independent errors of K accelerations.

    Args:
        phi: (10,) the load about the sensor's origin, sensor axes.
        angular_velocity: (N, 3) rad/s, sensor axes.
        sources: (N, 6, K) linear and angular acceleration of the sensor, its axes, by each of the K accelerations.
        sigma: (N, K) their one-sigma errors.
    """
    linear, angular = sources[:, :3], sources[:, 3:]
    response = motion_response(phi, angular_velocity, -linear, np.zeros_like(linear), angular)
    return np.asarray(np.sum((response * sigma[:, None, :]) ** 2, axis=2))


def base_sources(base: BaseMotion, rotation_world_sensor: Array, position_in_world: Array) -> Array:
    """(N, 6, 6) acceleration of the sensor, its axes, by the linear and angular acceleration of the base, base axes."""
    turn = np.einsum("nji,njk->nik", rotation_world_sensor, base.rotation_world_base)
    lever = np.einsum("nji,nj->ni", base.rotation_world_base, position_in_world - base.translation_world_base)
    out = np.zeros((len(turn), 6, 6))
    out[:, :3, :3], out[:, 3:, 3:] = turn, turn
    swept = [cross(np.broadcast_to(axis, lever.shape), lever) for axis in np.eye(3)]
    out[:, :3, 3:] = turn @ np.stack(swept, axis=2)
    return out
