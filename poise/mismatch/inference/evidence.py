"""Evidence of linear models with priors for whitened data, from small matrices.

Whitened data t (R,) and columns C (k, R), one per row, with t = C'c + e, e white, c normal about `mean` with
`precision`. Two small quantities describe what other columns X can add once C is projected out: the information
S = XX' - XC' A^-1 CX' and the vector s = Xt - XC' A^-1 b, with A = CC' + diag(precision).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.optimize import lsq_linear

from poise.types import Array, Mask

_ROUNDING = 1e-11
"""Relative, of sums over all samples."""


@dataclass(frozen=True, eq=False)
class WhitenedRegression:
    """Whitened data and the columns that are fitted under every hypothesis.

    Args:
        columns: (k, R) whitened, in the order channel by channel, each in time.
        precision: (k,) of their prior; 0 is none.
        mean: (k,) of their prior.
        target: (R,) whitened residual.
    """

    columns: Array
    precision: Array
    mean: Array
    target: Array

    @cached_property
    def _factor(self) -> Array:
        normal = self.columns @ self.columns.T
        size = np.arange(len(normal))
        normal[size, size] += self.precision + 1e-9
        return np.asarray(np.linalg.cholesky(normal), dtype=np.float64)

    @cached_property
    def _solved(self) -> tuple[Array, Array, float]:
        factor = self._factor
        right = self.columns @ self.target + self.precision * self.mean
        half = solve_triangular(factor, right, lower=True)
        square = float(self.target @ self.target + self.precision @ self.mean**2 - half @ half)
        return factor, half, square

    @property
    def square(self) -> float:
        """The least of |t - C' c|^2 + (c - mean)' precision (c - mean)."""
        return self._solved[2]

    @cached_property
    def log_evidence(self) -> float:
        """log p(t) up to a constant of the data; columns without a prior count as unit width."""
        factor, _, square = self._solved
        prior = float(np.log(self.precision[self.precision > 0]).sum())
        return -0.5 * square - float(np.log(np.diag(factor)).sum()) + 0.5 * prior

    def coefficients(self) -> Array:
        """(k,) the most likely c."""
        factor, half, _ = self._solved
        return np.asarray(solve_triangular(factor, half, lower=True, trans="T"))

    def covariance(self) -> Array:
        """(k, k) of c."""
        return np.asarray(cho_solve((self._solved[0], True), np.eye(len(self.mean))))

    def project(self, extra: Array) -> "ProjectedColumns":
        """Further columns (m, R), with these columns projected out."""
        factor, half, _ = self._solved
        across = solve_triangular(factor, self.columns @ extra.T, lower=True)
        whole = extra @ extra.T
        # Known columns cancel up to the rounding of large numbers: this much is not known.
        left = whole - across.T @ across + _ROUNDING * np.diag(np.diag(whole))
        return ProjectedColumns(left, extra @ self.target - across.T @ half)

    def extended(self, extra: Array, precision: Array, mean: Array) -> "WhitenedRegression":
        """With further columns that every later hypothesis includes."""
        return WhitenedRegression(
            np.vstack([self.columns, extra]),
            np.concatenate([self.precision, precision]),
            np.concatenate([self.mean, mean]),
            self.target,
        )

    def with_target(self, target: Array) -> "WhitenedRegression":
        """These columns with another residual (R,); their factorisation is reused."""
        made = WhitenedRegression(self.columns, self.precision, self.mean, target)
        made.__dict__["_factor"] = self._factor
        return made

    def rows(self, keep: Array) -> "WhitenedRegression":
        """Restricted to a mask (R,) of the data."""
        return WhitenedRegression(self.columns[:, keep], self.precision, self.mean, self.target[keep])


@dataclass(frozen=True, eq=False)
class ProjectedColumns:
    """Columns with those of a regression projected out: information S (m, m) and vector s (m,)."""

    information: Array
    vector: Array

    def solve(self, precision: Array, lower: Array | None = None) -> Array:
        """(m,) most likely coefficients for priors about zero, none below `lower` (m,)."""
        factor = np.linalg.cholesky(self._posterior(precision))
        free = np.asarray(cho_solve((factor, True), self.vector))
        if lower is None or (free >= lower).all():
            return free
        target = solve_triangular(factor, self.vector, lower=True)
        return np.asarray(lsq_linear(factor.T, target, (lower, np.inf), method="bvls").x)

    def drop(self, coefficients: Array) -> float:
        """Decrease of the square for these coefficients."""
        return float(2.0 * self.vector @ coefficients - coefficients @ self.information @ coefficients)

    def gain(self, precision: Array) -> float:
        """log evidence of the columns with normal priors about zero."""
        factor = np.linalg.cholesky(self._posterior(precision))
        half = solve_triangular(factor, self.vector, lower=True)
        return float(0.5 * half @ half - np.log(np.diag(factor)).sum() + 0.5 * np.log(precision).sum())

    def pick(self, index: Array | slice) -> "ProjectedColumns":
        """Some of the columns."""
        return ProjectedColumns(self.information[index][:, index], self.vector[index])

    def _posterior(self, precision: Array) -> Array:
        size = np.arange(len(precision))
        total = self.information.copy()
        total[size, size] += precision + 1e-9 * max(float(np.trace(total)), 1e-6) / max(len(size), 1)
        return total


def flat_width(information: Array) -> float:
    """log of the posterior volume in a unit cube of parameters with this information; at most zero."""
    if not len(information):
        return 0.0
    strength = np.linalg.eigvalsh((information + information.T) / 2)
    return float(np.minimum(0.5 * np.log(2.0 * np.pi / np.maximum(strength, 1e-9)), 0.0).sum())


def laplace_evidence(
    regression: WhitenedRegression, projected: ProjectedColumns, precision: Array, mean: Array, linear: Mask
) -> float:
    """Of a linearised hypothesis: exact in the linear parameters, Laplace's in the others."""
    if not len(linear):
        return regression.log_evidence
    first, other = np.flatnonzero(linear), np.flatnonzero(~linear)
    across = projected.information[np.ix_(first, other)]
    won = 0.0
    if len(first):
        factor = np.linalg.cholesky(projected.information[np.ix_(first, first)] + np.diag(precision[first]))
        half = solve_triangular(factor, projected.vector[first] + (precision * mean)[first], lower=True)
        won = 0.5 * float(half @ half) - float(np.log(np.diag(factor)).sum())
        won += 0.5 * float(np.log(precision[first]).sum()) - 0.5 * float((precision * mean**2)[first].sum())
        across = solve_triangular(factor, across, lower=True)
    bent = projected.information[np.ix_(other, other)] - across.T @ across
    return regression.log_evidence + won + flat_width(bent)
