"""What to know of an estimate: samples left out, a sensor zeroed too late, another object, nothing held."""

import numpy as np

from poise.errors import ErrorCode
from poise.geometry import STANDARD_GRAVITY, cross, cross_matrix
from poise.inertia.model import PARAMETER_NAMES, EstimateFinding, InertialParameters, about_com_jacobian
from poise.types import Array

_SURELY = 5.0
"""Standard deviations."""

_SHARP = 0.2
"""Relative uncertainty of a weight that two things have in common by more than chance."""

_LEAST_WEIGHT = 0.05
"""N."""

_CALIBRATION = 0.005
"""Relative error of a wrench by the sensor's calibration."""

_WEAK, _ROUNDING = 4.0, 1e-12
"""Standard deviations up to which a mass is hardly shown; an eigenvalue that may be zero."""

_UNSEEN = 1e-100
"""Information that is none."""

_CHI_SQUARE_4 = 18.5
"""99.9 % of chi-square with four degrees of freedom."""


def zeroed_under_load(unknowns: Array, covariance: Array, gravity: float, noise: Array) -> EstimateFinding | None:
    """Find a bias that is the weight of the payload with the opposite sign.

    A sensor zeroed while it holds the object reads nothing at that moment: its bias is minus the static wrench,
    so |b_f| = m g and b_tau = c x b_f, four conditions that a drifted sensor would meet by rare chance only. The
    noise of that moment is part of the bias: of a single sample, if the sensor averages none.

    Args:
        unknowns: (16,) phi and bias.
        covariance: (16, 16).
        gravity: m/s2.
        noise: (6,) standard deviations of one sample, N and N m.
    """
    phi, force, torque = unknowns[:10], unknowns[10:13], unknowns[13:]
    size = float(np.linalg.norm(force))
    weight = float(phi[0] * gravity)
    direction = force / max(size, np.finfo(np.float64).tiny)
    deviation = float(np.sqrt(direction @ covariance[10:13, 10:13] @ direction))
    if size <= _SURELY * deviation or deviation > _SHARP * weight:
        return None
    com = phi[1:4] / phi[0]
    mismatch = np.concatenate([[size - weight], torque - cross(com, force)])
    jacobian = np.zeros((4, 16))
    jacobian[0, 0] = -gravity
    jacobian[0, 10:13] = direction
    jacobian[1:, 0] = cross(com, force) / phi[0]
    jacobian[1:, 1:4] = cross_matrix(force) / phi[0]
    jacobian[1:, 10:13] = -cross_matrix(com)
    jacobian[1:, 13:] = np.eye(3)
    by_noise = jacobian[:, 10:] * noise
    by_calibration = _CALIBRATION * np.append(weight, np.full(3, weight * np.linalg.norm(com)))
    spread = jacobian @ covariance @ jacobian.T + by_noise @ by_noise.T + np.diag(by_calibration**2)
    if mismatch @ np.linalg.solve(spread, mismatch) > _CHI_SQUARE_4 or np.sqrt(spread[0, 0]) > _SHARP * weight:
        return None
    return EstimateFinding(
        ErrorCode.ZEROED_UNDER_LOAD,
        f"the sensor reads {size:.2f} N with nothing on it, which is this payload's weight turned around:"
        " it was zeroed while it held the object; the estimate allows for that, other users of the wrench do not:"
        " put the object down and zero the sensor",
    )


def wrong_shape(probability: float) -> EstimateFinding | None:
    """The finding that the wrench asks for another shape than was given, with this probability."""
    if probability < 0.5:
        return None
    return EstimateFinding(
        ErrorCode.SHAPE_MISMATCH,
        f"the wrench does not fit the shape that was given (probability {probability:.3f}): another object, another"
        " grasp, or parts that are not homogeneous; the estimate leans on the wrench instead: check shape and pose",
    )


def outside(com: Array) -> EstimateFinding:
    """The finding that the centre of mass is not inside the object."""
    place = ", ".join(f"{1e3 * value:.1f}" for value in com)
    return EstimateFinding(
        ErrorCode.SHAPE_MISMATCH,
        f"the centre of mass, ({place}) mm in the sensor frame, is outside the convex hull of the shape that was"
        " given: check its pose in the hand",
    )


def nothing_held(mass: float, deviation: float, noise: float) -> EstimateFinding | None:
    """The finding that the mass does not differ significantly from zero, for its deviation and the noise of a force.

    A tiny mass is none, however small its deviation: the zero of a sensor depends on its attitude by so much.
    """
    if deviation < mass / 2 and mass * STANDARD_GRAVITY > max(_LEAST_WEIGHT, noise / 2):
        return None
    return EstimateFinding(
        ErrorCode.NOT_IDENTIFIABLE,
        f"the mass, {mass:.4f} kg +- {deviation:.4f}, does not differ significantly from zero: nothing is held, the"
        " robot's controller subtracts the payload from the wrench (switch that off), or the motion and the"
        " time were too short for a sensor of this noise",
    )


def with_weak_mass(covariance: Array, phi: Array, information: Array) -> Array:
    """(16, 16) covariance of phi and bias for a body of unknown shape whose mass the samples hardly show.

    Its mass then follows from beliefs about its size, which are too vague to count: a first moment also fits a light
    body far away. The mass is as uncertain as the samples alone leave it.

    Args:
        covariance: (16, 16).
        phi: (10,).
        information: (10, 10) of the samples about phi, bias already integrated out.
    """
    units = np.sqrt(np.diag(information).clip(min=_UNSEEN))
    eigenvalues, vectors = np.linalg.eigh(information / np.outer(units, units))
    variance = float(vectors[0] ** 2 @ (1 / eigenvalues.clip(min=_ROUNDING))) / units[0] ** 2
    if phi[0] > _WEAK * np.sqrt(variance) or variance < covariance[0, 0]:
        return covariance
    direction = np.append(phi / phi[0], np.zeros(6))
    return np.asarray(covariance + (variance - covariance[0, 0]) * np.outer(direction, direction))


def not_shown(information: Array, phi: Array) -> tuple[str, ...]:
    """Names of the parameters that the motion alone cannot show: it leaves them less sure than their own scale.

    Args:
        information: (10, 10) of the samples about phi, nothing else; bias already integrated out.
        phi: (10,) the estimate, whose size sets the scale.
    """
    body = InertialParameters.from_phi(phi)
    moments = np.diag(body.inertia)
    radius = np.sqrt(moments.sum() / 2 / body.mass)
    products = np.sqrt(np.outer(moments, moments))[np.triu_indices(3)]
    scale = np.concatenate([[body.mass], np.full(3, radius), products])
    units = np.concatenate([[1.0], np.full(3, radius), np.full(6, radius**2)]) * body.mass
    jacobian = np.concatenate([np.eye(1, 10), about_com_jacobian(phi)]) * units / scale[:, None]
    eigenvalues, vectors = np.linalg.eigh(information * np.outer(units, units))
    variance = np.square(jacobian @ vectors) @ (1 / eigenvalues.clip(min=_UNSEEN))
    return tuple(name for name, value in zip(PARAMETER_NAMES, variance, strict=True) if value > 1)
