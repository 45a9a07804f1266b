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
    matrix[..., :3, 0] = specific
    matrix[..., 3:, 1:4] = -cross_matrix(specific)
    (ax, ay, az), (x, y, z) = np.moveaxis(alpha, -1, 0), np.moveaxis(omega, -1, 0)
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    # -[alpha]x - [omega]x [omega]x, and -L(alpha) - [omega]x L(omega) with I v = L(v) (Ixx, Ixy, Ixz, Iyy, Iyz, Izz).
    arm = ((yy + zz, az - xy, -ay - xz), (-az - xy, xx + zz, ax - yz), (ay - xz, -ax - yz, xx + yy))
    turn = (
        (-ax, xz - ay, -az - xy, yz, zz - yy, -yz),
        (-xz, -ax - yz, xx - zz, -ay, xy - az, xz),
        (xy, yy - xx, yz - ax, -xy, -ay - xz, -az),
    )
    for row in range(3):
        for column, value in enumerate(arm[row]):
            matrix[..., row, 1 + column] = value
        for column, value in enumerate(turn[row]):
            matrix[..., 3 + row, 4 + column] = value
    return matrix
