"""The wrench of a rigid load, and its derivatives by motion."""

import numpy as np
from numpy.typing import ArrayLike

from poise.geometry import cross
from poise.inertia.model import regressor, symmetric
from poise.types import Array


def load_wrench(phi: ArrayLike, specific: Array, angular_velocity: Array, angular_acceleration: Array) -> Array:
    """(N, 6) what a load exerts on the sensor (thesis eq. 2.97), sensor axes.

    f = m u - alpha x h - omega x (omega x h), tau = h x u - I alpha - omega x I omega, with h = m c.

    Args:
        phi: (10,), or (N, 10) when it changes over time.
        specific: (N, 3) m/s2, u = gravity minus acceleration of the sensor's origin.
        angular_velocity, angular_acceleration: (N, 3) rad/s, rad/s2.
    """
    values = np.asarray(phi, dtype=np.float64)
    if values.ndim == 2:
        return np.asarray(np.einsum("nij,nj->ni", regressor(specific, angular_velocity, angular_acceleration), values))
    mass, first, inertia = values[0], values[1:4], symmetric(values[4:])
    omega, alpha = angular_velocity, angular_acceleration
    force = mass * specific - cross(alpha, first) - cross(omega, cross(omega, first))
    torque = cross(first, specific) - alpha @ inertia - cross(omega, omega @ inertia)
    return np.concatenate([force, torque], axis=1)


def motion_response(phi: Array, omega: Array, by_specific: Array, by_omega: Array, by_alpha: Array) -> Array:
    """(N, 6, k) first-order change of a load's wrench when its motion changes in k ways.

    Args:
        phi: (10,).
        omega: (N, 3) rad/s.
        by_specific, by_omega, by_alpha: (N, 3, k) change of u, omega and alpha.
    """
    mass, first, inertia = phi[0], phi[1:4, None], symmetric(phi[4:])
    rate, momentum = omega[:, :, None], (omega @ inertia)[:, :, None]
    swing = cross(by_omega, cross(rate, first, axis=-2), axis=-2)
    swing += cross(rate, cross(by_omega, first, axis=-2), axis=-2)
    force = mass * by_specific - cross(by_alpha, first, axis=-2) - swing
    gyro = cross(by_omega, momentum, axis=-2) + cross(rate, inertia @ by_omega, axis=-2)
    torque = cross(first, by_specific, axis=-2) - inertia @ by_alpha - gyro
    return np.concatenate([force, torque], axis=1)


def forces_at(points: Array, forces: Array) -> Array:
    """(N, 6) wrench about the sensor's origin of (N, 3) forces at (N, 3) or (3,) points, sensor axes."""
    return np.concatenate([forces, cross(np.broadcast_to(points, forces.shape), forces)], axis=1)
