"""Least-squares quintic splines on uniform knots, their derivatives, and the noise of both; all matrices are banded."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from poise.types import Array

DEGREE = 5
_ORDER = DEGREE + 1

# Row j: coefficients (1, u, ..., u^5) of the j-th B-spline that is not zero on a knot interval, u in [0, 1)
# (Qin 1998, "General matrix representations for B-splines", degree 5).
_BASIS = (
    np.array(
        [
            [1, -5, 10, -10, 5, -1],
            [26, -50, 20, 20, -20, 5],
            [66, 0, -60, 0, 30, -10],
            [26, 50, 20, -20, -20, 10],
            [1, 5, 10, 10, 5, -5],
            [0, 0, 0, 0, 0, 1],
        ],
        dtype=np.float64,
    )
    / 120.0
)

_PLACES = np.arange(_ORDER)

_RIDGE = 1e-13
"""Weight of the third differences of the coefficients against the data: settles knot intervals without samples."""

_DECAY = 30
"""Knot intervals after which a sample no longer matters: its influence falls by 0.66 per interval, to 4e-6 here."""

_PHASES = 6
"""Places within a knot interval whose variances are averaged."""

_KEPT = 4
"""Arrays of times whose places are kept."""


@dataclass(frozen=True)
class Grid:
    """Uniform knots at `origin + spacing * (0, 1, ..., intervals)` seconds."""

    origin: float
    spacing: float
    intervals: int

    @classmethod
    def across(cls, seconds: Array, intervals: int) -> "Grid":
        """Knots from the first sample to the last."""
        return cls(float(seconds[0]), float(seconds[-1] - seconds[0]) / intervals, intervals)

    @property
    def size(self) -> int:
        """How many coefficients a spline on this grid has."""
        return self.intervals + DEGREE

    def locate(self, seconds: Array) -> tuple[NDArray[np.intp], Array]:
        """Knot interval of each time (N,), and the powers (N, 6) 1, u, ..., u^5 of its place u in it."""
        scaled = (seconds - self.origin) / self.spacing
        start = np.minimum(np.maximum(np.floor(scaled).astype(np.intp), 0), self.intervals - 1)
        place, powers = scaled - start, np.empty((_ORDER, len(seconds)))
        powers[0] = 1.0
        for k in range(1, _ORDER):
            np.multiply(powers[k - 1], place, out=powers[k])
        return start, powers.T

    def polynomials(self, derivative: int) -> Array:
        """(6, 6 - derivative) coefficients in u of the derivative of the six B-splines on a knot interval."""
        coefficients = _BASIS
        for _ in range(derivative):
            coefficients = coefficients[:, 1:] * np.arange(1, coefficients.shape[1]) / self.spacing
        return coefficients


class Design:
    """What a grid makes of the times (N,) of samples, not descending; worked out once for all splines through them.

    The samples of each knot interval stand in rows of equal length, filled up with zeros, so that sums over samples are
    products of small matrices.
    """

    def __init__(self, grid: Grid, seconds: Array) -> None:
        self.grid = grid
        self.seconds = seconds
        self.start, self.powers = grid.locate(seconds)
        count = np.bincount(self.start, minlength=grid.intervals)
        self._length = min(max(-(-2 * len(seconds) // grid.intervals), 1), int(count.max(initial=1)))
        rows = -(-count // self._length)
        first_row = np.concatenate([[0], np.cumsum(rows)])
        position = np.arange(len(seconds)) - np.concatenate([[0], np.cumsum(count)])[self.start]
        self._rows = int(first_row[-1])
        self._interval = np.repeat(np.arange(grid.intervals), rows)
        self._slots = (first_row[self.start] + position // self._length) * self._length + position % self._length
        self._windows = self._interval[:, None] + _PLACES
        self._filled = np.flatnonzero(np.diff(self._interval, prepend=-1))
        self._weights: dict[int, Array] = {}
        self._bands: dict[int, Array] = {}
        self._places: dict[int, tuple[Array, NDArray[np.intp], Array]] = {}

    def band(self, derivative: int) -> Array:
        """(6, size) normal matrix of the derivative in lower form: band[d, i] = A[i + d, i]."""
        if derivative not in self._bands:
            weights = self._weight_rows(derivative)
            gram = self._by_interval(_sums(weights, weights))
            band = np.zeros((_ORDER, self.grid.size))
            for i in range(_ORDER):
                band[: _ORDER - i, i : i + self.grid.intervals] += gram[:, i, i:].T
            self._bands[derivative] = band
        return self._bands[derivative]

    @cached_property
    def normal(self) -> "_Normal":
        """What the values alone say of the coefficients."""
        return _Normal(self.band(0) + self.ridge)

    @cached_property
    def ridge(self) -> Array:
        """(6, size) added to the normal matrix, in lower form: settles knot intervals without samples."""
        band, size = np.zeros((_ORDER, self.grid.size)), self.grid.size
        difference = np.array([-1.0, 3.0, -3.0, 1.0])
        strength = _RIDGE * max(len(self.seconds) / self.grid.intervals, 1.0)
        for d in range(4):
            band[d, : size - d] = strength * np.convolve(np.ones(size - 3), difference[: 4 - d] * difference[d:])
        return band

    def project(self, rows: Array, derivative: int) -> Array:
        """(size, K) B.T @ values, of values in rows (see `padded`) and the derivative's (N, size) matrix B."""
        parts = self._by_interval(_sums(self._weight_rows(derivative), rows))
        out = np.zeros((self.grid.size, rows.shape[2]))
        for i in range(_ORDER):
            out[i : i + self.grid.intervals] += parts[:, i]
        return out

    def evaluate(self, coefficients: Array, derivative: int) -> Array:
        """(N, K) B @ coefficients (size, K)."""
        rows = self.evaluate_rows(coefficients, derivative)
        return np.asarray(rows.reshape(-1, coefficients.shape[1]).take(self._slots, axis=0))

    def evaluate_rows(self, coefficients: Array, derivative: int) -> Array:
        """B @ coefficients (size, K) in rows, see `padded`."""
        return np.asarray(self._weight_rows(derivative) @ coefficients.take(self._windows, axis=0))

    def places(self, seconds: Array) -> tuple[NDArray[np.intp], Array]:
        """See `SplineFit._weights`; those of the last few arrays of times are kept, which must not be changed."""
        known = self._places.get(id(seconds))
        if known is None or known[0] is not seconds:
            start, powers = self.grid.locate(seconds)
            weights = np.empty((len(seconds), 3, _ORDER))
            for d in range(3):
                np.matmul(powers[:, : _ORDER - d], self.grid.polynomials(d).T, out=weights[:, d])
            if len(self._places) >= _KEPT:
                self._places.clear()
            known = self._places[id(seconds)] = seconds, start, weights
        return known[1:]

    def _weight_rows(self, derivative: int) -> Array:
        """(rows, length, 6) weights of the samples' six coefficients."""
        if derivative not in self._weights:
            polynomials = self.grid.polynomials(derivative)
            self._weights[derivative] = self.padded(self.powers[:, : polynomials.shape[1]] @ polynomials.T)
        return self._weights[derivative]

    def padded(self, values: Array) -> Array:
        """(rows, length, K) of values (N, K): by knot interval, filled up with zeros."""
        padded = np.zeros((self._rows * self._length, values.shape[1]))
        padded[self._slots] = values
        return padded.reshape(self._rows, self._length, values.shape[1])

    def _by_interval(self, parts: Array) -> Array:
        """(intervals, ...) sums of the rows (rows, ...) of each knot interval."""
        if len(self._filled) == self._rows == self.grid.intervals:
            return parts
        out = np.zeros((self.grid.intervals, *parts.shape[1:]))
        out[self._interval[self._filled]] = np.add.reduceat(parts, self._filled, axis=0)
        return out


class SplineFit:
    """The quintic spline on a grid that is nearest to samples in the sense of least squares; K columns at once.

    Args:
        design: the grid, and the times of the samples.
        values: (N, K).
    """

    def __init__(self, design: Design, values: Array) -> None:
        self.grid = design.grid
        self._design = design
        self._offset = values.mean(axis=0)  # so that the ridge and the rounding do not see where zero is
        self._normal = design.normal
        right = design.padded(values - self._offset)
        self.coefficients = self._normal.solve(design.project(right, 0))
        right -= design.evaluate_rows(self.coefficients, 0)
        gradient = design.project(right, 0)
        step = self._normal.solve(gradient)  # takes away what squaring the condition number cost
        self.coefficients = self.coefficients + step
        self.degrees_of_freedom = len(values) - self.grid.size
        self.square_sum = np.einsum("rlk,rlk->k", right, right) - np.einsum("ik,ik->k", step, gradient)

    @property
    def information(self) -> tuple[float, float]:
        """Traces of the normal matrices of values and of slopes: what samples of equal noise say about the spline."""
        return float(self._design.band(0)[0].sum()), float(self._design.band(1)[0].sum())

    def slope_sums(self, slopes: Array) -> tuple[Array, Array]:
        """Gradient (size, K) and square sum (K,) that measured first derivatives (N, K) leave about this spline."""
        left = self._design.padded(slopes) - self._design.evaluate_rows(self.coefficients, 1)
        return self._design.project(left, 1), np.einsum("rlk,rlk->k", left, left)

    def with_slopes(self, columns: NDArray[np.intp], sums: tuple[Array, Array], weights: Array) -> "SplineFit":
        """The fits of some columns that also follow measured first derivatives.

        Args:
            columns: (C,) which.
            sums: of `slope_sums`.
            weights: (C,) variance of the values over variance of the slopes, s2.
        """
        fit = self.select(columns)
        fit.__dict__.pop("_inverse_windows", None)
        gradient, square = weights * sums[0][:, columns], weights * sums[1][columns]
        bands = self._design.normal.band[:, None] + weights[:, None] * self._design.band(1)[:, None]
        fit._normal = _Normal(bands.reshape(_ORDER, -1))  # one column after the other: LAPACK solves them in one call
        step = fit._normal.solve(gradient.T.reshape(-1, 1)).reshape(len(columns), -1).T
        fit.coefficients = fit.coefficients + step
        fit.square_sum = np.maximum(fit.square_sum + square - np.einsum("ik,ik->k", step, gradient), 0.0)
        fit.degrees_of_freedom = 2 * (self.degrees_of_freedom + self.grid.size) - self.grid.size
        return fit

    def select(self, columns: NDArray[np.intp]) -> "SplineFit":
        """The fit of some columns (C,); of one alone where each has followed its own slopes."""
        fit = object.__new__(SplineFit)
        fit.__dict__.update(self.__dict__)
        for name in ("_offset", "coefficients", "square_sum"):
            setattr(fit, name, getattr(self, name)[..., columns])
        if self._normal.size > self.grid.size:
            fit._normal = self._normal.part(int(columns[0]), self.grid.size)
        return fit

    @property
    def sigma(self) -> Array:
        """(K,) one-sigma noise of the samples, from what the spline leaves over."""
        return np.asarray(np.sqrt(np.maximum(self.square_sum, 0.0) / max(self.degrees_of_freedom, 1)))

    def score(self) -> Array:
        """(K,) generalised cross-validation: about N times the squared error at a sample that was left out.

        Craven and Wahba 1979, with the effective number of coefficients raised by a fifth against overfitting
        (Kim and Gu 2004).
        """
        count = self.degrees_of_freedom + self.grid.size
        left = count - 1.2 * self.grid.size
        return np.asarray(count * self.square_sum / left**2 if left > 0 else np.full(len(self.square_sum), np.inf))

    def __call__(self, seconds: Array, derivative: int = 0) -> Array:
        """The spline or its derivative at (M,) times: (M, K)."""
        if seconds is self._design.seconds:
            value = self._design.evaluate(self.coefficients, derivative)
        else:
            start, powers = self.grid.locate(seconds)
            polynomials = self.grid.polynomials(derivative)
            weights = powers[:, : polynomials.shape[1]] @ polynomials.T
            value = np.einsum("ni,nik->nk", weights, self.coefficients[start[:, None] + _PLACES])
        return value + self._offset if derivative == 0 else value

    def derivatives(self, seconds: Array) -> Array:
        """(3, M, K) value, first and second derivative at (M,) times."""
        start, weights = self._weights(seconds)
        values = (weights @ self.coefficients.take(start[:, None] + _PLACES, axis=0)).swapaxes(0, 1)
        values[0] += self._offset
        return np.asarray(values)

    def gains(self, seconds: Array) -> Array:
        """(M, 3, 3) covariance of value, first and second derivative at (M,) times, for unit noise of the samples."""
        start, weights = self._weights(seconds)
        return np.asarray(weights @ self._inverse_windows[start] @ weights.swapaxes(1, 2))

    def usual_gains(self) -> Array:
        """(3,) variance of value, first and second derivative amid evenly spaced samples of unit noise."""
        middle = self.grid.intervals // 2
        low, high = max(middle - _DECAY, 0), min(middle + _ORDER + _DECAY, self.grid.size)
        window = self._normal.inverse(low, high)[
            middle - low : middle - low + _ORDER, middle - low : middle - low + _ORDER
        ]
        places = self.grid.origin + self.grid.spacing * (middle + (np.arange(_PHASES) + 0.5) / _PHASES)
        weights = self._weights(places)[1]
        return np.asarray(np.einsum("ndi,ij,ndj->d", weights, window, weights) / _PHASES)

    def _weights(self, seconds: Array) -> tuple[NDArray[np.intp], Array]:
        """Knot interval (M,) and weights (M, 3, 6) of its six coefficients in value, first and second derivative."""
        return self._design.places(seconds)

    @cached_property
    def _inverse_windows(self) -> Array:
        """(intervals, 6, 6) of the inverse normal matrix, what belongs to the six coefficients of each knot interval.

        The inverse is taken in blocks with enough neighbours for the rest not to matter.
        """
        windows = np.empty((self.grid.intervals, _ORDER, _ORDER))
        block = 4 * _DECAY
        for left in range(0, self.grid.intervals, block):
            right = min(left + block, self.grid.intervals)
            low, high = max(left - _DECAY, 0), min(right + _ORDER + _DECAY, self.grid.size)
            inverse = self._normal.inverse(low, high)
            rows = np.arange(left, right)[:, None] - low + np.arange(_ORDER)
            windows[left:right] = inverse[rows[:, :, None], rows[:, None, :]]
        return windows


class _Normal:
    """A positive band matrix (6, size) in lower form, scaled to a unit diagonal."""

    def __init__(self, band: Array) -> None:
        self.band = band
        self.size = band.shape[1]
        self._scale = 1.0 / np.sqrt(band[0])

    @cached_property
    def _factor(self) -> Array:
        return _cholesky(_scaled(self.band, self._scale))

    def solve(self, right: Array) -> Array:
        """(size, K) of right sides (size, K)."""
        scale = self._scale[:, None]
        return np.asarray(scale * scipy.linalg.lapack.dpbtrs(self._factor, scale * right, lower=1)[0])

    def inverse(self, low: int, high: int) -> Array:
        """Of the rows and columns `low` to `high` alone."""
        n = high - low
        scale = self._scale[low:high]
        band = _scaled(self.band[:, low:high], scale)
        inverse = scipy.linalg.lapack.dpbtrs(_cholesky(band), np.eye(n), lower=1)[0]
        return np.asarray(scale[:, None] * inverse * scale)

    def part(self, number: int, size: int) -> "_Normal":
        """One of several matrices of equal size along the diagonal."""
        return _Normal(self.band[:, number * size : (number + 1) * size])


def _sums(left: Array, right: Array) -> Array:
    """(R, I, K) sums over the samples (R, L) of products of left (R, L, I) and right (R, L, K)."""
    return np.asarray(np.swapaxes(left, 1, 2) @ right)


def _cholesky(band: Array) -> Array:
    """Of a positive band matrix in lower form; LAPACK without scipy's checks, which would take most of the time."""
    factor, failed = scipy.linalg.lapack.dpbtrf(band, lower=1)
    if failed:
        raise np.linalg.LinAlgError("the normal matrix of a spline is not positive definite")
    return np.asarray(factor)


def _scaled(band: Array, scale: Array) -> Array:
    out = band * scale
    for d in range(_ORDER):
        out[d, : len(scale) - d] *= scale[d:]
    return np.asarray(out)
