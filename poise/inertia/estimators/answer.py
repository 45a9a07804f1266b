"""The calling form that all batch estimators share, and the answer of one that computes phi alone."""

from collections.abc import Callable

import numpy as np

from poise.inertia.estimators.least_squares import NULL_EIGENVALUE
from poise.inertia.model import IdentificationProblem, InertialSolution, root_mean_square
from poise.types import Array

Method = Callable[[IdentificationProblem], InertialSolution]
"""The calling form of every estimator; what it cannot say of its answer (a covariance, often) is NaN."""


def answer(
    problem: IdentificationProblem,
    phi: Array,
    *,
    covariance: Array | None = None,
    bias: Array | None = None,
    bias_covariance: Array | None = None,
    unidentified: tuple[str, ...] = (),
) -> InertialSolution:
    """What a method that only gives phi (10,) comes to: residuals over all samples, condition number, NaN elsewhere."""
    offset = np.zeros(6) if bias is None else bias
    residual = problem.wrench - problem.regressor @ np.nan_to_num(phi) - np.nan_to_num(offset)
    squares = np.sum(residual.reshape(-1, 2, 3) ** 2, axis=(0, 2))
    return InertialSolution(
        phi=phi,
        covariance=np.full((10, 10), np.nan) if covariance is None else covariance,
        bias=offset,
        bias_covariance=np.full((6, 6), np.nan) if bias_covariance is None else bias_covariance,
        unidentified=unidentified,
        condition_number=np.inf if unidentified else condition_number(problem),
        residual_force=root_mean_square(squares[0], len(problem)),
        residual_torque=root_mean_square(squares[1], len(problem)),
        n_samples=len(problem),
        n_effective=float(len(problem)),
    )


def condition_number(problem: IdentificationProblem) -> float:
    """Of the noise-weighted normal matrix of phi with scaled columns, as in `InertialSolution`; infinite when singular.

    Its square root is the condition number of the scaled regressor (Gautier and Khalil 1992).
    """
    rows = (problem.regressor / problem.noise.wrench[:, None]).reshape(-1, 10)
    normal = rows.T @ rows
    scale = np.sqrt(np.diag(normal))
    scale[scale == 0] = 1.0
    eigenvalues = np.linalg.eigvalsh(normal / np.outer(scale, scale))
    return float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > NULL_EIGENVALUE else np.inf
