"""The spline through one stretch of samples: the search for its knots by cross-validation, and its errors."""

import math
from collections.abc import Callable
from functools import cache, lru_cache, partial

import numpy as np

from poise.robot.splines import DEGREE, Design, Grid, SplineFit
from poise.types import Array

_FASTEST = 300.0
"""Hz; of faster samples, several are averaged before a spline is fitted, so that about 250 Hz remain."""

_WORTHWHILE = 0.01
"""Information of measured rates, relative to that of the positions, below which they are not used."""

_SHORT = 1000
"""Samples of a stretch up to which its designs are kept for the next one; 64 of them take some 10 MB."""

_CHECKED = 120
"""Samples, evenly spread, at which a spline is compared with a finer one."""


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
        self._pieces: dict[tuple[int | None, ...], Array] = {}
        design = _designs(seconds)
        self._plain = cache(lambda m: SplineFit(design(m), values))
        columns = np.arange(values.shape[1])
        self._fit = [_column(self._plain, k) for k in range(values.shape[1])]
        scores = cache(lambda m: self._plain(m).score())
        if together:
            self._chosen = [self._intervals(spacing, lambda m: float(scores(m).sum()))] * len(columns)
        else:
            self._chosen = self._each_chosen(scores, rates, spacing)
        self.spacing = np.array([design(m).grid.spacing for m in self._chosen])

    def at(self, column: int, inside: slice) -> Array:
        """(3, M) position, velocity, acceleration at the samples inside."""
        values = self._fit[column](self._chosen[column]).derivatives(self._piece(self.seconds, inside))[:, :, 0]
        values[0] -= self._span**2 * (1.0 - self._count**-2.0) / 24.0 * values[2]  # what the mean over a bin adds
        return values

    def covariance(self, column: int, inside: slice) -> Array:
        """(M, 3, 3) of position, velocity and acceleration at the samples inside: noise, and the lag of the spline."""
        m = self._chosen[column]
        fit, finer = self._fit[column](m), self._fit[column](min(max(round(m * math.sqrt(2)), 2), self._most()))
        # The gain hardly changes from one sample to the next: of averaged samples, that of their mean.
        nearest = np.minimum(np.arange(inside.start, inside.stop) // self._count, len(self._at) - 1)
        gains = fit.gains(self._piece(self._at, slice(int(nearest[0]), int(nearest[-1]) + 1)))
        part = self._interior(m)
        step = max(-(-(part.stop - part.start) // _CHECKED), 1)
        checked = self._piece(self._at, slice(part.start, part.stop, step))
        difference = (fit.derivatives(checked) - finer.derivatives(checked))[:, :, 0]
        # The spline spaces nearly contain one another: the difference varies by what the finer one varies more.
        excess = finer.gains(checked) * finer.sigma**2 - fit.gains(checked) * fit.sigma**2
        lag = np.mean(difference**2 - np.diagonal(excess, axis1=1, axis2=2).T, axis=1)
        return np.asarray(gains[nearest - nearest[0]] * fit.sigma**2 + np.diag(np.maximum(lag, 0.0)))

    def _piece(self, samples: Array, part: slice) -> Array:
        """A part of samples, the same array each time, so that designs recognise it."""
        key = id(samples), part.start, part.stop, part.step
        if key not in self._pieces:
            self._pieces[key] = samples[part]
        return self._pieces[key]

    def _each_chosen(self, scores: Callable[[int], Array], rates: Array | None, spacing: float | None) -> list[int]:
        """Knot intervals of each column; columns follow their measured rates too where these are worth it."""
        score: list[Callable[[int], float]] = [partial(_entry, scores, k) for k in range(len(self._fit))]
        if spacing is not None:
            chosen = [self._given(spacing)] * len(score)
            self._follow_rates(rates, chosen)
            return chosen
        rungs = [self._coarse(each) for each in score]
        followed = self._follow_rates(rates, [self._rung(rung) for rung in rungs])
        score = [own or plain for own, plain in zip(followed, score, strict=True)]
        return [self._rung(self._near(rung, each)) for rung, each in zip(rungs, score, strict=True)]

    def _follow_rates(self, rates: Array | None, plain: list[int]) -> list[Callable[[int], float] | None]:
        """Let the columns follow their measured rates too, where these are worth it; the scores of those that do.

        Args:
            rates: (N, K); a column with NaN is not followed.
            plain: (K,) knot intervals for the positions alone.
        """
        result: list[Callable[[int], float] | None] = [None] * len(plain)
        if rates is None:
            return result
        finite = np.asarray(np.isfinite(rates).all(axis=0))
        slopes = np.nan_to_num(rates)
        sums = cache(lambda m: self._plain(m).slope_sums(slopes))
        weights = np.array([self._rate_weight(k, m, sums) if finite[k] else 0.0 for k, m in enumerate(plain)])
        which = np.flatnonzero(weights)
        followed = cache(lambda m: self._plain(m).with_slopes(which, sums(m), weights[which]))
        scores = cache(lambda m: followed(m).score())
        for place, k in enumerate(which):
            self._fit[k], result[k] = _column(followed, place), partial(_entry, scores, place)
        return result

    def _rate_weight(self, column: int, m: int, sums: Callable[[int], tuple[Array, Array]]) -> float:
        """s2, variance of a column's positions over that of its rates; 0 when these are not worth it."""
        best = self._plain(m)
        scatter = float(sums(m)[1][column]) / len(self._at)
        weight = float(best.sigma[column] ** 2) / scatter if scatter > 0 else 0.0
        band, rate_band = best.information
        return weight if weight * rate_band >= _WORTHWHILE * band else 0.0

    def _interior(self, m: int) -> slice:
        edge = min(round(3 * len(self._at) / m), len(self._at) // 4)
        return slice(edge, len(self._at) - edge)

    def _most(self) -> int:
        """Most knot intervals that still leave a third of the samples to judge by."""
        return max(len(self._at) * 2 // 3 - DEGREE, 1)

    def _intervals(self, spacing: float | None, score: Callable[[int], float]) -> int:
        return self._given(spacing) if spacing is not None else self._rung(self._near(self._coarse(score), score))

    def _given(self, spacing: float) -> int:
        """Knot intervals for a spacing in s."""
        return min(max(round(float(self._at[-1] - self._at[0]) / spacing), 1), self._most())

    def _rung(self, rung: int) -> int:
        """Knot intervals: 2^(rung / 4), within what is possible."""
        return min(max(round(math.pow(2.0, rung / 4)), 1), self._most())

    def _coarse(self, score: Callable[[int], float]) -> int:
        """The rung with the least score among the powers of two."""
        return min(range(0, 4 * self._most().bit_length(), 4), key=lambda rung: score(self._rung(rung)))

    def _near(self, rung: int, score: Callable[[int], float]) -> int:
        """The rung at the minimum that a descent from `rung` finds, first by half octaves, then by quarters."""
        for step in (2, 1):
            lower, higher = (score(self._rung(rung + way)) for way in (-step, step))
            way = step if higher < lower else -step
            least, best = min(lower, higher), score(self._rung(rung))
            while least < best:
                rung, best = rung + way, least
                least = score(self._rung(rung + way)) if step > 1 else math.inf
        return rung


def _column(fit: Callable[[int], SplineFit], column: int) -> Callable[[int], SplineFit]:
    """The fits of one column."""
    return cache(lambda m: fit(m).select(np.array([column])))


def _entry(values: Callable[[int], Array], place: int, m: int) -> float:
    return float(values(m)[place])


def _designs(seconds: Array) -> Callable[[int], Design]:
    """The design for each number of knot intervals; of short stretches those of the last ones are kept.

    Stretches with equal sample times, as from a controller with a steady clock, have equal designs.
    """
    if len(seconds) > _SHORT:
        return cache(lambda m: Design(Grid.across(seconds, m), seconds))
    return partial(_kept_design, seconds.tobytes())


@lru_cache(maxsize=64)
def _kept_design(seconds: bytes, intervals: int) -> Design:
    times = np.frombuffer(seconds)
    return Design(Grid.across(times, intervals), times)


def _bin_size(seconds: Array) -> int:
    """How many samples in a row are averaged before the fit."""
    rate = (len(seconds) - 1) / float(seconds[-1] - seconds[0])
    return max(round(rate / 250.0), 1) if rate > _FASTEST else 1


def _binned(values: Array, count: int) -> Array:
    """Means of `count` rows of (N, ...) in a row; the last one takes the remainder."""
    edges = np.arange(0, max(len(values) - count + 1, 1), count)
    sizes = np.diff(edges, append=len(values)).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(np.add.reduceat(values, edges, axis=0) / sizes)
