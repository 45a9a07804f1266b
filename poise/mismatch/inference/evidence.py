"""Evidence of linear models with priors for whitened data, from small matrices.

Whitened data t (R,) and columns C (k, R), one per row, with t = C'c + e, e white. A coefficient is normal about `mean`
with `precision`, or uniform between plus and minus its `bound`. The square of a model is that at the optimum inside the
bounds. For the volume of the posterior a uniform prior counts as the normal one of its variance, bound^2 / 3.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular

from poise.mismatch.inference.box import box_minimum
from poise.types import Array, Mask

_ROUNDING = 1e-11
"""Relative, of sums over all samples."""
_KEPT = 8_000_000
"""Bytes of columns up to which those of each channel are kept as well."""
_RIDGE = 0.01
"""Precision of a bounded coefficient in units of its bound: it selects the smallest where the data do not determine
it. At the bound it costs 0.005 of log likelihood."""
_SPANS = 10
"""Spans of time whose slopes are compared, see `WhitenedRegression.spread`."""


@dataclass(frozen=True, eq=False)
class WhitenedRegression:
    """Whitened data and the columns that are fitted under every hypothesis.

    Args:
        pieces: (k_i, R) whitened columns, in the order channel by channel, each in time; k is the sum of all k_i. They
            are not put together: the copy would take as long as their products.
        precision: (k,) of normal priors; 0 is none. Of bounded coefficients: 3 / bound^2.
        mean: (k,) of normal priors; 0 for bounded coefficients.
        target: (R,) whitened residual.
        bound: (k,) half-width of uniform priors about zero; infinite for normal ones.
        near: (k,) the most likely coefficients of a similar regression.
        channel: (k,) the channel in which a column acts alone; -1: in all. None: not known.
        channels: of the data.
    """

    pieces: tuple[Array, ...]
    precision: Array
    mean: Array
    target: Array
    bound: Array | float = np.inf
    near: Array | None = None
    channel: NDArray[np.intp] | None = None
    channels: int = 1

    @cached_property
    def columns(self) -> Array:
        """(k, R) the pieces together."""
        return self.pieces[0] if len(self.pieces) == 1 else np.vstack(self.pieces)

    @property
    def count(self) -> int:
        """k, the number of columns."""
        return len(self.mean)

    @cached_property
    def bounds(self) -> Array:
        """(k,) half-widths of the uniform priors."""
        return np.broadcast_to(self.bound, self.mean.shape)

    @cached_property
    def _normal(self) -> Array:
        normal = np.zeros((self.count, self.count))
        for rows, _, part in self._parts if self._small else self._taken():
            normal[rows[:, None], rows] += part @ part.T
        return normal

    @property
    def _small(self) -> bool:
        return sum(piece.nbytes for piece in self.pieces) < _KEPT

    @cached_property
    def _parts(self) -> list[tuple[NDArray[np.intp], slice, Array]]:
        return list(self._taken())

    def _taken(self) -> Iterator[tuple[NDArray[np.intp], slice, Array]]:
        """Of each channel the columns that act there, with their rows and samples: most act in one channel alone."""
        if self.channel is None:
            yield np.arange(len(self.columns)), slice(None), self.columns
            return
        length = self.columns.shape[1] // self.channels
        for number in range(self.channels):
            rows = np.flatnonzero((self.channel < 0) | (self.channel == number))
            place = slice(number * length, (number + 1) * length)
            yield rows, place, self.columns[rows, place]

    def _across(self, others: Array) -> Array:
        """(k, m) products with other columns (m, R)."""
        if not self._small:
            return np.vstack([piece @ others.T for piece in self.pieces])
        products = np.zeros((self.count, len(others)))
        for rows, place, part in self._parts:
            products[rows] += part @ others[:, place].T
        return products

    @cached_property
    def _factor(self) -> Array:
        return np.asarray(np.linalg.cholesky(self._normal + np.diag(self.precision + 1e-9)), dtype=np.float64)

    @cached_property
    def penalty(self) -> Array:
        """(k,) of the squares of the coefficients about their means: precision, or hardly any inside bounds."""
        return np.asarray(np.where(np.isfinite(self.bounds), _RIDGE / self.bounds**2, self.precision) + 1e-9)

    @cached_property
    def curvature(self) -> Array:
        """(k, k) of half the square by the coefficients."""
        return self._normal + np.diag(self.penalty)

    @cached_property
    def right(self) -> Array:
        """(k,) minus the slope of half the square at zero coefficients."""
        return self._across(self.target[None])[:, 0] + self.penalty * self.mean

    @cached_property
    def _solved(self) -> Array:
        return box_minimum(self.curvature, self.right, -self.bounds, self.bounds, self.near)

    @cached_property
    def square(self) -> float:
        """The least of |t - C' c|^2 and the penalties, inside the bounds."""
        c = self._solved
        fixed = self.target @ self.target + self.penalty @ self.mean**2
        return float(fixed + c @ (self.curvature @ c - 2.0 * self.right))

    @cached_property
    def log_evidence(self) -> float:
        """log p(t) up to a constant of the data; columns without a prior count as unit width."""
        prior = float(np.log(self.precision[self.precision > 0]).sum())
        return -0.5 * self.square - float(np.log(np.diag(self._factor)).sum()) + 0.5 * prior

    def coefficients(self) -> Array:
        """(k,) the most likely c."""
        return self._solved

    @property
    def residual(self) -> Array:
        """(R,) whitened data less the columns at the most likely coefficients."""
        ends = np.cumsum([len(piece) for piece in self.pieces])
        parts = zip(np.split(self._solved, ends[:-1]), self.pieces, strict=True)
        return np.asarray(self.target - sum(part @ piece for part, piece in parts))

    def covariance(self) -> Array:
        """(k, k) of c, with uniform priors as normal ones."""
        return np.asarray(cho_solve((self._factor, True), np.eye(len(self.mean))))

    @cached_property
    def spread(self) -> Array:
        """(k,) one sigma of c: that of `covariance`, or what the data show where no coefficients explain them.

        The slopes of the square by c scatter over spans of time as much as noise lets them. Where the columns misfit,
        they scatter more (the sandwich estimate; Huber 1967, White 1982, "Maximum likelihood estimation of misspecified
        models"). Spans are long, since a misfit repeats with the motion.
        """
        covariance, left = self.covariance(), self.residual.reshape(self.channels, -1)
        cuts = np.linspace(0, left.shape[1], _SPANS + 1).astype(int)
        moved = np.zeros((self.count, _SPANS))
        for i, (begin, end) in enumerate(itertools.pairwise(cuts.tolist())):
            slopes = [
                np.einsum("kcn,cn->k", piece.reshape(len(piece), *left.shape)[:, :, begin:end], left[:, begin:end])
                for piece in self.pieces
            ]
            moved[:, i] = covariance @ np.concatenate(slopes)
        return np.asarray(np.sqrt(np.maximum(np.diag(covariance), (moved**2).sum(axis=1))))

    def project(self, extra: Array) -> "ProjectedColumns":
        """Further columns (m, R) beside these."""
        across = self._across(extra)
        half = solve_triangular(self._factor, across, lower=True)
        whole = extra @ extra.T
        # Known columns cancel up to the rounding of large numbers: this much is not known.
        whole += _ROUNDING * np.diag(np.diag(whole))
        return ProjectedColumns(self, whole - half.T @ half, whole, across, extra @ self.target)

    def extended(
        self, extra: Array, precision: Array, mean: Array, bound: Array | float = np.inf
    ) -> "WhitenedRegression":
        """With further columns that every later hypothesis includes."""
        made = WhitenedRegression(
            (*self.pieces, extra),
            np.concatenate([self.precision, precision]),
            np.concatenate([self.mean, mean]),
            self.target,
            np.concatenate([self.bounds, np.broadcast_to(bound, mean.shape)]),
            channel=None if self.channel is None else np.append(self.channel, np.full(len(extra), -1)),
            channels=self.channels,
        )
        across = self._across(extra)
        made.__dict__["_normal"] = np.block([[self._normal, across], [across.T, extra @ extra.T]])
        made.__dict__["right"] = np.concatenate([self.right, extra @ self.target + made.penalty[self.count :] * mean])
        return made

    def with_target(self, target: Array) -> "WhitenedRegression":
        """These columns with another residual (R,); their products are reused."""
        known = (self.pieces, self.precision, self.mean, target, self.bounds, self._solved)
        made = WhitenedRegression(*known, self.channel, self.channels)
        made.__dict__.update(_normal=self._normal, _factor=self._factor, curvature=self.curvature)
        if self._small:
            made.__dict__["_parts"] = self._parts
        return made


@dataclass(frozen=True, eq=False)
class ProjectedColumns:
    """Columns X beside those of a regression C.

    Args:
        beside: the regression.
        information: (m, m) of X with C projected out: XX' - XC' A^-1 CX', A = CC' + diag(precision).
        products, across, vector: XX' (m, m), CX' (k, m) and Xt (m,).
        _last: the last solution, from which the next one starts.
    """

    beside: WhitenedRegression
    information: Array
    products: Array
    across: Array
    vector: Array
    _last: list[Array] = field(default_factory=list, init=False, repr=False)

    def fitted(self, precision: Array, mean: Array | None = None, lower: Array | None = None) -> tuple[Array, float]:
        """(m,) most likely coefficients, and the decrease of the square with its penalties from zero coefficients.

        Args:
            precision, mean: (m,) of normal priors; the mean is zero by default.
            lower: (m,) no coefficient is below; None: no bound.
        """
        known, count = self.beside, len(self.vector)
        size = len(known.mean)
        curvature = np.empty((size + count, size + count))
        curvature[:size, :size] = known.curvature
        curvature[:size, size:], curvature[size:, :size] = self.across, self.across.T
        curvature[size:, size:] = self.products + np.diag(precision + self._least())
        right = np.concatenate([known.right, self.vector if mean is None else self.vector + precision * mean])
        free = np.full(count, np.inf)
        low = np.concatenate([-known.bounds, -free if lower is None else lower])
        first = np.concatenate([known.coefficients(), np.zeros(count)])
        near = self._last[0] if self._last else first
        both = box_minimum(curvature, right, low, np.concatenate([known.bounds, free]), near)
        self._last[:] = [both]
        before = first @ (0.5 * curvature @ first - right)
        return both[size:], float(2.0 * (before - both @ (0.5 * curvature @ both - right)))

    def drop(self, coefficients: Array) -> float:
        """Decrease of the square for these coefficients, without their prior."""
        known = self.beside
        right, before = known.right - self.across @ coefficients, known.coefficients()
        after = box_minimum(known.curvature, right, -known.bounds, known.bounds, before)
        gone = 2.0 * self.vector @ coefficients - coefficients @ self.products @ coefficients
        gone += before @ (known.curvature @ before - 2.0 * known.right)
        return float(gone - after @ (known.curvature @ after - 2.0 * right))

    def gain(self, precision: Array) -> float:
        """log evidence of the columns with normal priors about zero."""
        return 0.5 * self.fitted(precision)[1] - self.narrowing(precision)

    def narrowing(self, precision: Array) -> float:
        """log of the ratio of the volumes of prior and posterior."""
        factor = np.linalg.cholesky(self.information + np.diag(precision + self._least()))
        return float(np.log(np.diag(factor)).sum() - 0.5 * np.log(precision).sum())

    def pick(self, index: NDArray[np.intp] | slice) -> "ProjectedColumns":
        """Some of the columns."""
        if len(self.vector[index]) == len(self.vector):
            return self
        return ProjectedColumns(
            self.beside,
            self.information[index][:, index],
            self.products[index][:, index],
            self.across[:, index],
            self.vector[index],
        )

    def _least(self) -> float:
        """Precision that keeps matrices definite."""
        return 1e-9 * max(float(np.trace(self.information)), 1e-6) / max(len(self.vector), 1)


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
        prior, about, inner = precision[first], mean[first], projected.pick(first)
        won = 0.5 * (inner.fitted(prior, about)[1] - float(prior @ about**2)) - inner.narrowing(prior)
        factor = np.linalg.cholesky(inner.information + np.diag(prior))
        across = solve_triangular(factor, across, lower=True)
    bent = projected.information[np.ix_(other, other)] - across.T @ across
    return regression.log_evidence + won + flat_width(bent)
