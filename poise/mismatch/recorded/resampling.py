"""Values interpolated at other times, linearly or by cubic splines, and smoothed.

scipy.interpolate would do the same, but with scipy.optimize it takes longer to import than a short diagnosis computes.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg.lapack import dgtsv
from scipy.ndimage import gaussian_filter1d

from poise.types import Array


def smoothing(values: Array, period: float, widths: Sequence[float]) -> Array:
    """(N, C, K) by how much Gaussian filters of widths (K), s, change values (N, C) that are `period`, s, apart."""
    smooth = [gaussian_filter1d(values, width / period, axis=0, mode="nearest") for width in widths]
    return np.stack([each - values for each in smooth], axis=2)


def at_times(seconds: Array, values: Array, wanted: Array) -> Array:
    """(M, ...) values (N, ...) at other times, by a cubic spline without knots at the second and the last but one.

    Args:
        seconds: (N,) ascending, four at least.
        values: (N, ...).
        wanted: (M,); outside the samples, values are held constant.
    """
    if np.array_equal(seconds, wanted):  # efforts without a wrench: the spline goes through the samples
        return np.array(values)
    rows = np.array(values.reshape(len(values), -1).T, order="C")
    found = hermite(seconds, rows, _slopes(seconds, rows), np.clip(wanted, seconds[0], seconds[-1]))
    return np.ascontiguousarray(found.T).reshape(len(wanted), *values.shape[1:])


def linear_at(seconds: Array, values: Array, wanted: Array) -> Array:
    """(M, C) values (N, C) at other times, linearly between samples; outside them, values are held constant."""
    return np.stack([np.interp(wanted, seconds, column) for column in values.T], axis=1)


def hermite(seconds: Array, values: Array, slopes: Array, wanted: Array, derivative: int = 0) -> Array:
    """(K, M) the cubics between samples (N,) with values and slopes (K, N), or their slopes, at times inside (M,)."""
    place = np.clip(np.searchsorted(seconds, wanted, side="right") - 1, 0, len(seconds) - 2)
    step = (seconds[1:] - seconds[:-1])[place]
    u = (wanted - seconds[place]) / step
    begin = values.take(place, axis=1)
    rise = values.take(place + 1, axis=1) - begin
    first, last = slopes.take(place, axis=1) * step, slopes.take(place + 1, axis=1) * step
    square, cube = 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise
    if derivative:
        return np.asarray((first + u * (2.0 * square + 3.0 * u * cube)) / step)
    return np.asarray(begin + u * (first + u * (square + u * cube)))


def _slopes(seconds: Array, values: Array) -> Array:
    """(K, N) slopes at the samples, for which the second derivative is continuous (de Boor 1978, chapter IV)."""
    step = np.diff(seconds)
    rise = np.diff(values) / step
    diagonal, lower, upper = np.empty(len(seconds)), np.empty(len(step)), np.empty(len(step))
    right = np.empty(values.shape)
    diagonal[1:-1], lower[:-1], upper[1:] = 2.0 * (step[:-1] + step[1:]), step[1:], step[:-1]
    right[:, 1:-1] = 3.0 * (step[1:] * rise[:, :-1] + step[:-1] * rise[:, 1:])
    # The third derivative is continuous at the second and the last but one sample, too.
    for end, near, far, across in ((0, 0, 1, upper), (-1, -1, -2, lower)):
        both = step[near] + step[far]
        diagonal[end], across[end] = step[far], both
        lean = (step[near] + 2.0 * both) * step[far] * rise[:, near] + step[near] ** 2 * rise[:, far]
        right[:, end] = lean / both
    return np.asarray(dgtsv(lower, diagonal, upper, right.T, overwrite_b=1)[3].T)
