"""The wrench a rigid load exerts on a moving sensor, as a matrix times its inertial parameters."""

import numpy as np
from numpy.typing import ArrayLike

from poise.geometry import cross_matrix
from poise.types import Array


def regressor(
    gravity_minus_acceleration: ArrayLike, angular_velocity: ArrayLike, angular_acceleration: ArrayLike
) -> Array:
    """Build A(g - a, omega, alpha) with [f; tau] = A phi (thesis eq. 2.97 and 3.2; Atkeson et al. 1986).

    In the sign of the contract (what the load exerts ON the sensor, at the sensor's origin):
    f = m (g - a) - alpha x mc - omega x (omega x mc) and tau = mc x (g - a) - I alpha - omega x I omega.

    Args:
        gravity_minus_acceleration: (..., 3) gravity minus the acceleration of the sensor's origin, m/s2, sensor axes.
        angular_velocity: (..., 3) rad/s, sensor axes.
        angular_acceleration: (..., 3) rad/s2, sensor axes.

    Returns:
        (..., 6, 10), force rows first, for phi = (m, m c, I about the sensor's origin).
    """
    specific, omega, alpha = (
        np.asarray(value, dtype=np.float64)
        for value in (gravity_minus_acceleration, angular_velocity, angular_acceleration)
    )
    matrix = np.zeros((*specific.shape[:-1], 6, 10))
    omega_cross = cross_matrix(omega)
    matrix[..., :3, 0] = specific
    matrix[..., :3, 1:4] = -cross_matrix(alpha) - omega_cross @ omega_cross
    matrix[..., 3:, 1:4] = -cross_matrix(specific)
    matrix[..., 3:, 4:] = -inertia_product(alpha) - omega_cross @ inertia_product(omega)
    return matrix


def inertia_product(vector: Array) -> Array:
    """(..., 3, 6) L(v) with I v = L(v) (Ixx, Ixy, Ixz, Iyy, Iyz, Izz)."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    matrix = np.zeros((*vector.shape, 6))
    matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 0, 2] = x, y, z
    matrix[..., 1, 1], matrix[..., 1, 3], matrix[..., 1, 4] = x, y, z
    matrix[..., 2, 2], matrix[..., 2, 4], matrix[..., 2, 5] = x, y, z
    return matrix
