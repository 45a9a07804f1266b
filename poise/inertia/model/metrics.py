"""How wrong an estimate is: in shares of the object's own size, on the manifold of bodies, and as predicted effort."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.geometry import GRAVITY_IN_WORLD
from poise.inertia.model.parameters import UPPER, InertialParameters, pseudo_inertia
from poise.inertia.model.wrench_regressor import regressor
from poise.robot import SensorMotion
from poise.types import Array


@dataclass(frozen=True)
class Errors:
    """The errors of one estimate.

    Args:
        mass: e_m, %.
        com: e_c, %, mean over the three axes.
        inertia: e_I, %, mean over the six entries on and above the diagonal.
        riemannian: e_Rie, no unit; NaN when the estimate is not physically consistent.
        consistent: a body with the estimated parameters can exist.
    """

    mass: float
    com: float
    inertia: float
    riemannian: float
    consistent: bool


def errors(estimate: InertialParameters, truth: InertialParameters, bounding_box: ArrayLike) -> Errors:
    """All error measures of thesis section 3 at once.

    Args:
        estimate, truth: in the same frame.
        bounding_box: (3,) side lengths of the object's bounding box along the axes of that frame, m.

    Raises:
        InputError: BAD_INPUT for a side that is not positive or a true mass that is not.
    """
    return Errors(
        mass=mass_error(estimate, truth),
        com=float(np.mean(com_errors(estimate, truth, bounding_box))),
        inertia=float(np.mean(inertia_errors(estimate, truth, bounding_box)[UPPER])),
        riemannian=riemannian_error(estimate, truth),
        consistent=estimate.is_consistent,
    )


def mass_error(estimate: InertialParameters, truth: InertialParameters) -> float:
    """e_m, % (thesis eq. 3.15)."""
    return 100 * abs(estimate.mass - truth.mass) / truth.mass


def com_errors(estimate: InertialParameters, truth: InertialParameters, bounding_box: ArrayLike) -> Array:
    """(3,) e_c per axis in % of the bounding box (thesis eq. 3.16)."""
    return 100 * np.abs(estimate.com - truth.com) / _box(bounding_box)


def inertia_errors(estimate: InertialParameters, truth: InertialParameters, bounding_box: ArrayLike) -> Array:
    """(3, 3) e_I per entry in % of what a solid cuboid of the object's size would have (thesis eq. 3.17).

    The tensors compared are those about each body's own centre of mass, along the axes of the given frame. The thesis
    leaves the point open, and its public code takes them about the sensor's origin: there an error of the mass or of
    the centre of mass, which e_m and e_c already count, enters again with the square of the distance to the sensor.
    """
    return 100 * np.abs(estimate.inertia - truth.inertia) / inertia_scale(truth.mass, bounding_box)


def inertia_scale(mass: float, bounding_box: ArrayLike) -> Array:
    """(3, 3) kg m2, the denominator of thesis eq. 3.17: m/12 |delta_ij (ax2 + ay2 + az2) - ai aj|.

    On the diagonal that is the moment of inertia of the solid cuboid.
    """
    box = _box(bounding_box)
    if not mass > 0:
        raise InputError(ErrorCode.BAD_INPUT, f"error measures: the true mass is {mass} kg; it must be positive")
    return np.asarray(mass / 12 * np.abs(np.eye(3) * (box @ box) - np.outer(box, box)))


def riemannian_error(estimate: InertialParameters, truth: InertialParameters) -> float:
    """e_Rie = sqrt(1/2 sum log^2 lambda), lambda the eigenvalues of P(estimate)^-1 P(truth); thesis eq. 3.29-3.31.

    The distance of two bodies on the manifold of positive definite pseudo-inertias: it does not depend on the frame.
    Erratum: eq. 3.29 prints sqrt(1/2 sum lambda), without log and square. That is sqrt(2) for a perfect estimate and
    not a distance at all; Lee et al. 2019 (eq. 17) and the thesis' own code have the formula used here.

    Returns:
        NaN when the estimate is not physically consistent, for then it is not on the manifold.
    """
    if not (estimate.is_consistent and np.all(np.isfinite(estimate.phi))):
        return math.nan
    # In the frame of the true centre of mass and its axes of inertia the matrices are as well conditioned as can be.
    at_com = -truth.com
    true = pseudo_inertia(truth.in_frame(np.eye(3), at_com).phi)
    factor = np.linalg.inv(np.linalg.cholesky(true))
    eigenvalues = np.linalg.eigvalsh(factor @ pseudo_inertia(estimate.in_frame(np.eye(3), at_com).phi) @ factor.T)
    if eigenvalues[0] <= 0:
        return math.nan
    return float(np.sqrt(np.sum(np.log(eigenvalues) ** 2) / 2))


def expected_errors(covariance: ArrayLike, truth: InertialParameters, bounding_box: ArrayLike) -> tuple[Array, Array]:
    """What e_m, e_c and e_I are on average when phi scatters normally around the truth, to first order.

    Gives a Cramer-Rao bound in the terms of the tables: the mean of |x| is sqrt(2/pi) of its standard deviation.

    Args:
        covariance: (10, 10) of phi.
        truth: the parameters.
        bounding_box: (3,) m.

    Returns:
        (3,) mean e_m, e_c, e_I in %, and (10,) standard deviations of m, c (3) and the inertia about the centre of
        mass (6): kg, m, kg m2.
    """
    jacobian = _jacobian_at_com(truth)
    deviations = np.sqrt(np.maximum(np.diag(jacobian @ np.asarray(covariance) @ jacobian.T), 0.0))
    scale = np.concatenate(
        [[truth.mass], _box(bounding_box), np.asarray(inertia_scale(truth.mass, bounding_box)[UPPER])]
    )
    shares = 100 * np.sqrt(2 / np.pi) * deviations / scale
    return np.array([shares[0], shares[1:4].mean(), shares[4:].mean()]), deviations


def predict_wrench(
    parameters: InertialParameters, motion: SensorMotion, gravity: ArrayLike = GRAVITY_IN_WORLD
) -> Array:
    """(N, 6) N, N m: the effort that a load will cost along a motion (thesis fig. 3.8, eq. 3.2).

    Args:
        parameters: of the load, in the sensor frame.
        motion: how the sensor is going to move.
        gravity: (3,) m/s2 in the world.
    """
    specific = motion.gravity_in_sensor(gravity) - motion.linear_acceleration_in_sensor
    matrix = regressor(specific, motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor)
    return np.asarray(matrix @ parameters.phi)


def effort_error(
    estimate: InertialParameters,
    truth: InertialParameters,
    motion: SensorMotion,
    gravity: ArrayLike = GRAVITY_IN_WORLD,
) -> Array:
    """(2,) error of the predicted force and torque along a motion, in % of the true ones (root mean squares)."""
    true = predict_wrench(truth, motion, gravity).reshape(-1, 2, 3)
    difference = predict_wrench(estimate, motion, gravity).reshape(-1, 2, 3) - true
    return np.asarray(100 * np.linalg.norm(difference, axis=(0, 2)) / np.linalg.norm(true, axis=(0, 2)))


def _box(bounding_box: ArrayLike) -> Array:
    box = np.asarray(bounding_box, dtype=np.float64)
    if box.shape != (3,) or not np.all(np.isfinite(box) & (box > 0)):
        raise InputError(ErrorCode.BAD_INPUT, f"bounding box {box.tolist()}: give three positive lengths in metres")
    return box


def _jacobian_at_com(truth: InertialParameters) -> Array:
    """(10, 10) derivative of (m, c, I about the centre of mass) with respect to phi.

    With J = I_o - m (c c 1 - c c^T) and s = m c: dI = dI_o - [2 c.ds 1 - ds c^T - c ds^T] + dm (c.c 1 - c c^T).
    """
    com, one = truth.com, np.eye(3)
    jacobian = np.zeros((10, 10))
    jacobian[0, 0] = 1
    jacobian[1:4, 0] = -com / truth.mass
    jacobian[1:4, 1:4] = one / truth.mass
    jacobian[4:, 0] = (com @ com * one - np.outer(com, com))[UPPER]
    for axis in range(3):
        step = one[axis]
        jacobian[4:, 1 + axis] = -(2 * com @ step * one - np.outer(step, com) - np.outer(com, step))[UPPER]
    jacobian[4:, 4:] = np.eye(6)
    return jacobian
