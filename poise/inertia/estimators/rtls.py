"""RTLS: recursive total least squares, which grants errors to the accelerations too (Kubus, Kroeger and Wahl 2008)."""

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.estimators.answer import answer
from poise.inertia.estimators.entry import EstimatorEntry
from poise.inertia.estimators.sample_window import SampleWindow
from poise.inertia.model import IdentificationProblem, InertialSolution, NoiseLevels, regressor
from poise.types import Array

# A smallest singular vector with less of the measurement in it than this stands for no solution at all.
_NONGENERIC = 1e-10


class RecursiveTotalLeastSquares:
    """Total least squares of [A, y] (phi, -1) = 0, one update per sample, in memory and time that do not grow.

    Rows are divided by the noise of force and torque, columns by the root mean square of the noise that the
    accelerations bring into them, so that errors are alike everywhere, as total least squares assumes. (They are not
    independent: one acceleration enters several columns. Nor does it know the shape; that is the method's limit.)

    What is kept is the triangle R of a QR factorisation of all rows so far. A sample appends six rows, and Householder
    reflections make a triangle of it again (a rank-six update; nothing is squared). R has the singular values and
    right singular vectors of all rows, so the answer, from the vector of the smallest one, is that of the whole batch.
    Columns without error (those of a bias, or all when accelerations are exact) stand first in R and are solved for
    afterwards: mixed least squares and total least squares (Van Huffel and Vandewalle 1991, section 3.5).

    Args:
        noise: of wrench and accelerations; says whether there are six columns for a bias.
    """

    def __init__(self, noise: NoiseLevels) -> None:
        self._wrench_noise = noise.wrench
        error = np.concatenate([_column_noise(noise), np.zeros(6 if noise.has_bias else 0)])
        self._order = np.argsort(error > 0, kind="stable")
        self._n_exact = int(np.sum(error == 0))
        self._scale = np.where(error > 0, error, 1.0)
        columns = len(error) + 1
        self._triangle = np.zeros((columns, columns))
        self.n_samples = 0

    def add(self, regressor: ArrayLike, wrench: ArrayLike) -> None:
        """Take samples: the rows (N, 6, 10) of `poise.inertia.regressor` and wrenches (N, 6), N and N m; or one."""
        matrix = np.asarray(regressor, dtype=np.float64).reshape(-1, 6, 10)
        columns = len(self._triangle)
        block = np.empty((len(matrix), 6, columns))
        block[..., :10] = matrix
        block[..., 10:-1] = np.eye(6)[:, : columns - 11]
        block[..., :-1] = (block[..., :-1] / self._scale)[..., self._order]
        block[..., -1] = np.asarray(wrench, dtype=np.float64).reshape(-1, 6)
        block /= self._wrench_noise[:, None]
        rows = np.concatenate([self._triangle, block.reshape(-1, columns)])
        self._triangle = np.asarray(np.linalg.qr(rows, mode="r"))
        self.n_samples += len(matrix)

    def solve(self) -> tuple[Array, Array]:
        """Phi (10,) and bias (6,), which is zero when there is none.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES when rows do not outnumber unknowns, NOT_IDENTIFIABLE when the smallest
                singular vector has nothing to do with the measurement or columns without error depend on each other.
        """
        n_unknowns, exact = len(self._triangle) - 1, self._n_exact
        if 6 * self.n_samples <= n_unknowns:
            raise NoAnswerError(
                ErrorCode.TOO_FEW_SAMPLES,
                f"rtls: {self.n_samples} samples do not outnumber {n_unknowns} unknowns; record longer",
                n_samples=self.n_samples,
            )
        vector = np.linalg.svd(self._triangle[exact:, exact:])[2][-1]
        diagonal = np.abs(np.diag(self._triangle)[:exact])
        if abs(vector[-1]) < _NONGENERIC or np.any(diagonal <= 1e-12 * diagonal.max(initial=0.0)):
            raise NoAnswerError(
                ErrorCode.NOT_IDENTIFIABLE,
                "rtls: the motion leaves a combination of parameters open; turn and accelerate about all axes",
            )
        noisy = -vector[:-1] / vector[-1]
        right = self._triangle[:exact, -1] - self._triangle[:exact, exact:-1] @ noisy
        ordered = np.concatenate([np.linalg.solve(self._triangle[:exact, :exact], right), noisy])
        unknowns = np.zeros(16)
        unknowns[self._order] = ordered
        unknowns[:n_unknowns] /= self._scale
        return unknowns[:10], unknowns[10:]


def rtls(problem: IdentificationProblem) -> InertialSolution:
    """Total least squares of all samples, without covariance; see `RecursiveTotalLeastSquares`.

    Raises:
        NoAnswerError: as `RecursiveTotalLeastSquares.solve`.
    """
    estimator = RecursiveTotalLeastSquares(problem.noise)
    estimator.add(problem.regressor, problem.wrench)
    phi, bias = estimator.solve()
    return answer(problem, phi, bias=bias)


def _column_noise(noise: NoiseLevels) -> Array:
    """(10,) root mean square over the six rows, each in units of its wrench noise, of the errors in a column of A."""
    axes, still = np.eye(3), np.zeros((3, 3))
    linear = regressor(noise.linear_acceleration * axes, still, still)
    angular = regressor(still, still, noise.angular_acceleration * axes)
    errors = np.concatenate([linear, angular]) / noise.wrench[:, None]
    return np.asarray(np.sqrt(np.sum(errors**2, axis=(0, 1)) / 6))


ENTRY = EstimatorEntry(
    "rtls",
    "recursive total least squares",
    estimate=rtls,
    stream=lambda prior: SampleWindow(rtls, prior),
    needs_every_parameter=True,
)
