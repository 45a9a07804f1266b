"""Quintic regression splines through one stretch of samples, whose knots cross-validation chooses."""

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.types import Array


class CompiledSplines:
    """The splines of K columns; needs `COMPILED`. See `poise.robot.smoother.Smoother`, which does the same.

    Args:
        seconds: (N,) not descending; the last one is later than the first one.
        values: (N, K) finite.
        rates: (N, K) measured first derivatives, or None; columns that are not finite are not followed.
        intervals: of the knots; None: chosen.
        together: the same knots for all columns; rates are then not followed.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
        numpy.linalg.LinAlgError: a normal matrix is not positive definite.
    """

    def __init__(
        self, seconds: Array, values: Array, rates: Array | None, intervals: int | None, together: bool
    ) -> None:
        self._handle = None
        self._seconds = contiguous(seconds, -1, what="sample times")
        n = len(self._seconds)
        if n < 2:
            raise InputError(ErrorCode.TOO_FEW_SAMPLES, f"{n} samples are too few for a spline")
        given = contiguous(values, n, -1, what="samples")
        self._offset = given.mean(axis=0)
        left = given - self._offset
        columns = given.shape[1]
        followed, slopes = np.zeros(columns, dtype=np.int64), None
        if rates is not None and not together:
            slopes = contiguous(rates, n, columns, what="rates of samples")
            followed[:] = np.isfinite(slopes).all(axis=0)
            slopes = np.nan_to_num(slopes)
        self.intervals = np.zeros(columns, dtype=np.int64)
        status = np.zeros(1, dtype=np.int64)
        arrays = map(address, (self._seconds, left, slopes, followed))
        chosen = (intervals or 0, int(together), address(self.intervals), address(status))
        self._handle = library.poise_smoother_new(n, columns, *arrays, *chosen)
        check(int(status[0]))

    def __del__(self) -> None:
        if self._handle:
            library.poise_smoother_free(self._handle)
            self._handle = None

    def at(self, column: int, seconds: ArrayLike) -> Array:
        """(3, M) value, first and second derivative of a column at (M,) times."""
        self._require(column)
        times = contiguous(seconds, -1, what="times")
        values = np.empty((3, len(times)))
        check(library.poise_smoother_at(self._handle, column, len(times), address(times), address(values)))
        values[0] += self._offset[column]
        return values

    def covariance(self, column: int, samples: slice, finer: int, checked: slice) -> tuple[Array, Array]:
        """Of value, first and second derivative of a column.

        Args:
            column: which. samples: for which samples.
            finer: knot intervals of the spline that shows how far this one lags, and
            checked: at which samples.

        Returns:
            (M, 3, 3) for the noise of the samples, and (3,) the mean square by which the spline lags.
        """
        self._require(column, samples, checked)
        count = samples.stop - samples.start
        covariance, lag = np.empty((count, 3, 3)), np.empty(3)
        where = (samples.start, count, finer, checked.start, checked.stop, checked.step or 1)
        arrays = address(covariance), address(lag)
        check(library.poise_smoother_covariance(self._handle, column, *where, *arrays))
        return covariance, lag

    def _require(self, column: int, *parts: slice) -> None:
        """The library does not check what it is asked for."""
        n = len(self._seconds)
        whole = all(0 <= part.start <= part.stop <= n and (part.step or 1) > 0 for part in parts)
        if not (whole and 0 <= column < len(self.intervals)):
            raise IndexError(f"column {column}, samples {parts}: there are {len(self.intervals)} columns of {n}")
