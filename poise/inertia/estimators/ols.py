"""OLS: ordinary least squares of the wrench (Atkeson, An and Hollerbach 1986), the baseline of thesis chapter 3."""

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.estimators.answer import answer
from poise.inertia.estimators.entry import EstimatorEntry, MotionNeed
from poise.inertia.estimators.least_squares import NULL_EIGENVALUE, NULL_SHARE
from poise.inertia.estimators.least_squares_stream import LeastSquaresStream
from poise.inertia.model import PARAMETER_NAMES, IdentificationProblem, InertialSolution


def ols(problem: IdentificationProblem) -> InertialSolution:
    """Minimise ||A phi + bias - y||_2, every row with the same weight (thesis eq. 3.2).

    Newton metres weigh as much as newtons, as in the paper and the thesis; `least_squares.solve` weighs by noise.
    Bias columns are there when the sensor may have a bias. Nothing keeps the answer physically consistent.

    Returns:
        A covariance from the residuals of force and torque, without the errors of the kinematics; NaN where the
        motion shows nothing.

    Raises:
        NoAnswerError: TOO_FEW_SAMPLES when rows do not outnumber unknowns.
    """
    n, n_unknowns = len(problem), 16 if problem.noise.has_bias else 10
    if 6 * n <= n_unknowns:
        raise NoAnswerError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"ols: {n} samples do not outnumber {n_unknowns} unknowns; record longer",
            n_samples=n,
        )
    rows = np.concatenate([problem.regressor, np.broadcast_to(np.eye(6), (n, 6, 6))], axis=2)[:, :, :n_unknowns]
    normal = np.einsum("kri,krj->ij", rows, rows)
    scale = np.sqrt(np.diag(normal))
    scale[scale == 0] = 1.0
    eigenvalues, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    seen = eigenvalues > NULL_EIGENVALUE
    basis = vectors[:, seen] / scale[:, None]
    inverse = (basis / eigenvalues[seen]) @ basis.T
    unknowns = inverse @ np.einsum("kri,kr->i", rows, problem.wrench)
    residual = (problem.wrench - rows @ unknowns).reshape(-1, 3)
    freedom = 1 - np.sum(seen) / (6 * n)
    variances = np.repeat([np.mean(residual[0::2] ** 2), np.mean(residual[1::2] ** 2)], 3) / freedom
    covariance = inverse @ np.einsum("kri,r,krj->ij", rows, variances, rows) @ inverse
    hidden = np.linalg.norm(vectors[:, ~seen], axis=1) > NULL_SHARE
    unknowns = np.where(hidden, np.nan, unknowns)
    covariance[hidden, :] = covariance[:, hidden] = np.nan
    return answer(
        problem,
        unknowns[:10],
        covariance=covariance[:10, :10],
        bias=unknowns[10:] if problem.noise.has_bias else None,
        bias_covariance=covariance[10:, 10:] if problem.noise.has_bias else None,
        unidentified=tuple(np.array(PARAMETER_NAMES)[hidden[:10]].tolist()),
    )


ENTRY = EstimatorEntry(
    "ols",
    "weighted least squares on motion",
    estimate=ols,
    stream=LeastSquaresStream,
    motion=MotionNeed.MOVING,
    gives_covariance=True,
    uses_imu=False,
)
