"""Weighted linear least squares of the wrench model: parameters, bias, what cannot be seen, and the covariance."""

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.estimators.information import (
    FORCE_GROUP,
    TORQUE_GROUP,
    InformationAccumulator,
    correlation_factor,
    quadratic,
)
from poise.inertia.model import N_UNKNOWNS, PARAMETER_NAMES, InertialSolution, root_mean_square
from poise.types import Array

# Eigenvalues of the scaled information matrix below this are rounding: the direction was not excited.
NULL_EIGENVALUE = 1e-11
# A direction takes part in a parameter above this share.
NULL_SHARE = 1e-5
# One sigma as wide as the whole mass swung by this many metres says nothing about what a hand can hold.
_REACH = 0.1
_MAX_ITERATIONS = 50
# N^2 and (N m)^2, far below what a sensor resolves: wrenches without noise, or all zero, get finite weights.
_LEAST_VARIANCE = 1e-24


def solve(information: InformationAccumulator, noise: ArrayLike | None = None) -> InertialSolution:
    """Estimate phi and bias (Atkeson et al. 1986), force and torque weighted by their noise.

    Without `noise` the two variances are estimated with the parameters, each from its own residuals and with the
    degrees of freedom that the solution takes from it, until both agree. The covariance is widened by how residuals
    hang together in time (see `correlation_factor`), and by nothing else: errors of the kinematics are not in it.

    Args:
        information: the samples.
        noise: (2,) standard deviation of a force [N] and a torque [N m] sample, when they are known.

    Raises:
        NoAnswerError: TOO_FEW_SAMPLES when the samples do not outnumber the unknowns,
            NOT_IDENTIFIABLE when none of the ten parameters can be seen.
    """
    n = information.n_samples
    if n < 3:
        raise NoAnswerError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"{n} wrench samples can be used, and at least 3 are needed: record longer, or see what was rejected",
            n_samples=n,
        )
    sums = information.sums
    variances = _noise_variances(sums, n, noise)
    weighted = _Weighted(sums, variances)
    for _ in range(_MAX_ITERATIONS):
        if noise is not None:
            break
        estimated = _residual_variances(sums, n, weighted)
        weighted, previous = _Weighted(sums, estimated), variances
        variances = estimated
        if np.allclose(variances, previous, rtol=1e-13, atol=0.0):
            break
    return _solution(information, weighted)


class _Weighted:
    """The solution for given variances of force and torque.

    Args:
        sums: (2, 17, 17), see `InformationAccumulator`.
        variances: (2,) N^2 and (N m)^2.
    """

    def __init__(self, sums: Array, variances: Array) -> None:
        self.parts = sums[:, :N_UNKNOWNS, :N_UNKNOWNS] / variances[:, None, None]
        normal = self.parts.sum(axis=0)
        scale = np.sqrt(np.diag(normal))
        scale[scale == 0] = 1.0
        eigenvalues, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
        seen = eigenvalues > NULL_EIGENVALUE
        basis = vectors[:, seen] / scale[:, None]
        self.inverse = (basis / eigenvalues[seen]) @ basis.T
        self.unknowns = self.inverse @ np.einsum("gi,g->i", sums[:, :N_UNKNOWNS, N_UNKNOWNS], 1 / variances)
        self.hidden = np.linalg.norm(vectors[:, ~seen], axis=1) > NULL_SHARE
        self.condition_number = float(eigenvalues[-1] / eigenvalues[0]) if seen.all() else np.inf
        # Degrees of freedom that the solution takes from force and from torque.
        self.used = np.einsum("ij,gji->g", self.inverse, self.parts)


def _noise_variances(sums: Array, n: int, noise: ArrayLike | None) -> Array:
    """(2,) the given variances, or a first guess: the mean square of what was measured."""
    if noise is not None:
        return np.square(np.asarray(noise, dtype=np.float64))
    return np.maximum(sums[:, N_UNKNOWNS, N_UNKNOWNS] / (3 * n), _LEAST_VARIANCE)


def _residual_variances(sums: Array, n: int, weighted: _Weighted) -> Array:
    """(2,) variance of force and torque about the solution; kept above what rounding leaves of the measurement."""
    freedom = 3 * n - weighted.used
    if np.any(freedom < 1):
        raise NoAnswerError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"{n} wrench samples can be used, no more than there are unknowns: record longer, in more attitudes",
            n_samples=n,
        )
    variances: Array = quadratic(sums, weighted.unknowns) / freedom
    rounding = 1e-14 * sums[:, N_UNKNOWNS, N_UNKNOWNS] / (3 * n)
    return variances.clip(min=np.maximum(rounding, _LEAST_VARIANCE))


def _solution(information: InformationAccumulator, weighted: _Weighted) -> InertialSolution:
    """Widen the covariance by what hangs together in time, and blank out what cannot be seen."""
    n = information.n_samples
    factor = correlation_factor(information, weighted.unknowns, weighted.used)
    meat = np.einsum("gij,g->ij", weighted.parts, factor)
    covariance = weighted.inverse @ meat @ weighted.inverse
    covariance = (covariance + covariance.T) / 2  # to the last digit
    hidden = weighted.hidden.copy()
    hidden[:10] |= np.sqrt(np.diag(covariance)[:10]) > _useless_deviation(weighted.unknowns[0])
    if hidden[:10].all():
        raise NoAnswerError(
            ErrorCode.NOT_IDENTIFIABLE,
            f"the {n} samples show none of the parameters apart from the sensor's bias:"
            " hold the payload in at least three attitudes that differ by 30 degrees or more",
            n_samples=n,
        )
    unknowns = np.where(hidden, np.nan, weighted.unknowns)
    covariance[hidden, :] = covariance[:, hidden] = np.nan
    squares = information.residual_squares(weighted.unknowns)
    return InertialSolution(
        phi=unknowns[:10],
        covariance=covariance[:10, :10],
        bias=unknowns[10:],
        bias_covariance=covariance[10:, 10:],
        unidentified=tuple(np.array(PARAMETER_NAMES)[hidden[:10]].tolist()),
        condition_number=np.inf if hidden.any() else weighted.condition_number,
        residual_force=root_mean_square(squares[FORCE_GROUP], n),
        residual_torque=root_mean_square(squares[TORQUE_GROUP], n),
        n_samples=n,
        n_effective=float(n / factor.max()),
    )


def _useless_deviation(mass: float) -> Array:
    """(10,) standard deviations above which a parameter counts as not seen, for a mass in kg."""
    heavy = max(abs(mass), 1.0)
    return heavy * np.array([1.0] + [_REACH] * 3 + [_REACH**2] * 6)
