"""The spline through one stretch of samples: the search for its knots by cross-validation, and its errors."""

import math
from typing import Protocol

import numpy as np

from poise.kernels import COMPILED, CompiledSplines
from poise.robot.spline_search import SplineSearch
from poise.robot.splines import DEGREE
from poise.types import Array, Indices

_FASTEST = 300.0
"""Hz; of faster samples, several are averaged before a spline is fitted, so that about 250 Hz remain."""

_CHECKED = 120
"""Samples, evenly spread, at which a spline is compared with a finer one."""


class _Splines(Protocol):
    """What `SplineSearch` and `CompiledSplines` have in common."""

    intervals: Indices

    def at(self, column: int, seconds: Array) -> Array: ...
    def covariance(self, column: int, samples: slice, finer: int, checked: slice) -> tuple[Array, Array]: ...


class Smoother:
    """The splines with the best knots for one stretch without gaps, and their errors; one for each column."""

    def __init__(
        self, seconds: Array, values: Array, rates: Array | None, spacing: float | None, together: bool = False
    ) -> None:
        self.seconds, self.values = seconds, values
        self._count, self._span = _bin_size(seconds), 0.0
        if self._count > 1:
            self._span = float(seconds[-1] - seconds[0]) * self._count / (len(seconds) - 1)
            seconds, values = _binned(seconds, self._count), _binned(values, self._count)
            rates = None if rates is None else _binned(rates, self._count)
        self._at = seconds
        self._inside: tuple[slice, Array] = slice(0), seconds[:0]
        given = None if spacing is None else self._given(spacing)
        made = CompiledSplines if COMPILED else SplineSearch
        self._splines: _Splines = made(seconds, values, rates, given, together)
        self.spacing = float(seconds[-1] - seconds[0]) / self._splines.intervals

    def at(self, column: int, inside: slice) -> Array:
        """(3, M) position, velocity, acceleration at the samples inside."""
        if self._inside[0] != inside:  # the same array for every column, so that designs recognise it
            self._inside = inside, self.seconds[inside]
        values = self._splines.at(column, self._inside[1])
        values[0] -= self._span**2 * (1.0 - self._count**-2.0) / 24.0 * values[2]  # what the mean over a bin adds
        return values

    def covariance(self, column: int, inside: slice) -> Array:
        """(M, 3, 3) of position, velocity and acceleration at the samples inside: noise, and the lag of the spline."""
        m = int(self._splines.intervals[column])
        finer = min(max(round(m * math.sqrt(2)), 2), self._most())
        # The gain hardly changes from one sample to the next: of averaged samples, that of their mean.
        nearest = np.minimum(np.arange(inside.start, inside.stop) // self._count, len(self._at) - 1)
        part = self._interior(m)
        checked = slice(part.start, part.stop, max(-(-(part.stop - part.start) // _CHECKED), 1))
        noise, lag = self._splines.covariance(column, slice(int(nearest[0]), int(nearest[-1]) + 1), finer, checked)
        return np.asarray(noise[nearest - nearest[0]] + np.diag(lag))

    def _interior(self, m: int) -> slice:
        edge = min(round(3 * len(self._at) / m), len(self._at) // 4)
        return slice(edge, len(self._at) - edge)

    def _most(self) -> int:
        """Most knot intervals that still leave a third of the samples to judge by."""
        return max(len(self._at) * 2 // 3 - DEGREE, 1)

    def _given(self, spacing: float) -> int:
        """Knot intervals for a spacing in s."""
        return min(max(round(float(self._at[-1] - self._at[0]) / spacing), 1), self._most())


def _bin_size(seconds: Array) -> int:
    """How many samples in a row are averaged before the fit."""
    rate = (len(seconds) - 1) / float(seconds[-1] - seconds[0])
    return max(round(rate / 250.0), 1) if rate > _FASTEST else 1


def _binned(values: Array, count: int) -> Array:
    """Means of `count` rows of (N, ...) in a row; the last one takes the remainder."""
    edges = np.arange(0, max(len(values) - count + 1, 1), count)
    sizes = np.diff(edges, append=len(values)).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(np.add.reduceat(values, edges, axis=0) / sizes)
