"""Least-squares quintic splines on uniform knots, their derivatives, and the noise of both."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.sparse import csr_array

from poise.types import Array

DEGREE = 5
ORDER = DEGREE + 1

# Row j: coefficients (1, u, ..., u^5) of the j-th B-spline that is not zero on a knot interval, u in [0, 1)
# (Qin 1998, "General matrix representations for B-splines", degree 5).
BASIS = (
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

RIDGE = 1e-13
"""Weight of the third differences of the coefficients against the data: settles knot intervals without samples."""

DECAY = 30
"""Knot intervals after which a sample no longer matters: its influence falls by 0.66 per interval, to 4e-6 here."""


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

    @classmethod
    def at_multiples(cls, seconds: Array, spacing: float) -> "Grid":
        """Knots at multiples of `spacing` that cover all samples: a sliding window keeps them where they are."""
        first, last = np.floor(seconds[0] / spacing), np.ceil(seconds[-1] / spacing)
        return cls(float(first * spacing), spacing, max(int(last - first), 1))

    @property
    def size(self) -> int:
        """How many coefficients a spline on this grid has."""
        return self.intervals + DEGREE

    def basis(self, seconds: Array, derivative: int = 0) -> tuple[NDArray[np.intp], Array]:
        """First coefficient that matters at each time (N,), and the six weights (N, 6) of it and the next ones."""
        scaled = (seconds - self.origin) / self.spacing
        start = np.clip(np.floor(scaled).astype(np.intp), 0, self.intervals - 1)
        powers = np.vander(scaled - start, ORDER, increasing=True)
        coefficients = BASIS
        for _ in range(derivative):
            coefficients = coefficients[:, 1:] * np.arange(1, coefficients.shape[1]) / self.spacing
        return start, powers[:, : coefficients.shape[1]] @ coefficients.T

    def matrix(self, seconds: Array, derivative: int = 0) -> csr_array:
        """(N, size) sparse B with spline(seconds) = B @ coefficients."""
        start, weights = self.basis(seconds, derivative)
        columns = (start[:, None] + np.arange(ORDER)).ravel()
        rows = np.arange(0, weights.size + 1, ORDER)
        return csr_array((weights.ravel(), columns, rows), shape=(len(seconds), self.size))


class Design:
    """What a grid makes of the times (N,) of samples; worked out once, for all splines through samples there."""

    def __init__(self, grid: Grid, seconds: Array) -> None:
        self.grid = grid
        self.seconds = seconds
        self._matrices: dict[int, csr_array] = {}
        self._bands: dict[int, Array] = {}

    def matrix(self, derivative: int) -> csr_array:
        """(N, size) see `Grid.matrix`."""
        if derivative not in self._matrices:
            self._matrices[derivative] = self.grid.matrix(self.seconds, derivative)
        return self._matrices[derivative]

    def band(self, derivative: int) -> Array:
        """(6, size) its normal matrix in lower form: band[d, i] = A[i + d, i]."""
        if derivative not in self._bands:
            size = self.grid.size
            band = np.zeros((ORDER, size))
            start, weights = self.grid.basis(self.seconds, derivative)
            for i in range(ORDER):
                for j in range(i, ORDER):
                    products = weights[:, i] * weights[:, j]
                    band[j - i] += np.bincount(start + i, weights=products, minlength=size)
            self._bands[derivative] = band
        return self._bands[derivative]


class SplineFit:
    """The quintic spline on `grid` that is nearest to samples in the sense of least squares; K columns at once.

    Args:
        grid: the knots.
        seconds: (N,) not descending.
        values: (N, K).
        slopes: (N, K) measured first derivatives, or None.
        slope_weight: variance of the values over variance of the slopes, s2.
        design: of the grid at these times, when it is there already.
    """

    def __init__(
        self,
        grid: Grid,
        seconds: Array,
        values: Array,
        slopes: Array | None = None,
        slope_weight: float = 0.0,
        design: Design | None = None,
    ) -> None:
        self.grid = grid
        self._design = design or Design(grid, seconds)
        self._offset = values.mean(axis=0)  # so that the ridge and the rounding do not see where zero is
        self._factor_normal_matrix(slope_weight if slopes is not None else 0.0)
        self.coefficients = np.zeros((grid.size, values.shape[1]))
        basis, basis_1 = self._design.matrix(0), self._design.matrix(1) if slopes is not None else None
        for _ in range(2):  # the second round takes away what squaring the condition number cost
            right = basis.T @ (values - self._offset - basis @ self.coefficients)
            if basis_1 is not None:
                right += slope_weight * (basis_1.T @ (slopes - basis_1 @ self.coefficients))
            self.coefficients += self._solve(right)
        square = (values - self(seconds)) ** 2
        count = len(values)
        if slopes is not None:
            square = np.vstack([square, slope_weight * (slopes - self(seconds, 1)) ** 2])
            count *= 2
        self.degrees_of_freedom = count - grid.size
        self.square_sum = square.sum(axis=0)

    @property
    def sigma(self) -> Array:
        """(K,) one-sigma noise of the samples, from what the spline leaves over."""
        return np.asarray(np.sqrt(self.square_sum / max(self.degrees_of_freedom, 1)))

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
        own = seconds is self._design.seconds
        matrix = self._design.matrix(derivative) if own else self.grid.matrix(seconds, derivative)
        value = np.asarray(matrix @ self.coefficients)
        return value + self._offset if derivative == 0 else value

    def gain(self, seconds: Array, derivative: int = 0) -> Array:
        """(M,) one-sigma noise of the (derivative's) value for unit noise of the samples: sqrt(b' A^-1 b).

        The inverse is taken in blocks with enough neighbours for the rest not to matter.
        """
        start, weights = self.grid.basis(seconds, derivative)
        gain = np.empty(len(seconds))
        block = 4 * DECAY
        for left in range(0, self.grid.intervals, block):
            here = np.flatnonzero((start >= left) & (start < left + block))
            if not here.size:
                continue
            low, high = max(left - DECAY, 0), min(left + block + ORDER + DECAY, self.grid.size)
            inverse = self._inverse(low, high)
            columns = start[here, None] - low + np.arange(ORDER)
            local = inverse[columns[:, :, None], columns[:, None, :]]
            gain[here] = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", weights[here], local, weights[here]), 0.0))
        return gain

    def _factor_normal_matrix(self, slope_weight: float) -> None:
        size = self.grid.size
        band = self._design.band(0).copy()
        if slope_weight > 0.0:
            band += slope_weight * self._design.band(1)
        difference = np.array([-1.0, 3.0, -3.0, 1.0])
        strength = RIDGE * max(len(self._design.seconds) / self.grid.intervals, 1.0)
        for i in range(4):
            for j in range(i, 4):
                band[j - i, i : size - 3 + i] += strength * difference[i] * difference[j]
        self._band = band
        self._scale = 1.0 / np.sqrt(band[0])
        self._factor = _cholesky(_scaled(band, self._scale))

    def _solve(self, right: Array) -> Array:
        scale = self._scale[:, None]
        return np.asarray(scale * lapack.dpbtrs(self._factor, scale * right, lower=1)[0])

    def _inverse(self, low: int, high: int) -> Array:
        n = high - low
        scale = self._scale[low:high]
        band = _scaled(self._band[:, low:high], scale)
        for d in range(1, ORDER):
            band[d, n - d :] = 0.0
        inverse = lapack.dpbtrs(_cholesky(band), np.eye(n), lower=1)[0]
        return np.asarray(scale[:, None] * inverse * scale)


def _cholesky(band: Array) -> Array:
    """Of a positive band matrix in lower form; LAPACK without scipy's checks, which would take most of the time."""
    factor, failed = lapack.dpbtrf(band, lower=1)
    if failed:
        raise np.linalg.LinAlgError("the normal matrix of a spline is not positive definite")
    return np.asarray(factor)


def _scaled(band: Array, scale: Array) -> Array:
    scaled = np.zeros_like(band)
    for d in range(len(band)):
        n = band.shape[1] - d
        scaled[d, :n] = band[d, :n] * scale[:n] * scale[d:]
    return scaled
