"""The search for the knots of splines through samples, in numpy; `poise.kernels.CompiledSplines` does the same in C."""

import math
from collections.abc import Callable
from functools import cache, lru_cache, partial

import numpy as np

from poise.robot.splines import DEGREE, Design, Grid, SplineFit
from poise.types import Array, Indices

_WORTHWHILE = 0.01
"""Information of measured rates, relative to that of the positions, below which they are not used."""

_SHORT = 1000
"""Samples of a stretch up to which its designs are kept for the next one; 64 of them take some 10 MB."""


class SplineSearch:
    """The splines of K columns with the knots that generalised cross-validation prefers.

    Args:
        seconds: (N,) not descending.
        values: (N, K) finite.
        rates: (N, K) measured first derivatives, or None; columns that are not finite are not followed.
        intervals: of the knots; None: chosen.
        together: the same knots for all columns; rates are then not followed.
    """

    def __init__(
        self, seconds: Array, values: Array, rates: Array | None, intervals: int | None, together: bool
    ) -> None:
        self._at = seconds
        self._pieces: dict[tuple[int, int, int | None], Array] = {}
        design = _designs(seconds)
        self._plain = cache(lambda m: SplineFit(design(m), values))
        columns = np.arange(values.shape[1])
        self._fit = [_column(self._plain, k) for k in range(values.shape[1])]
        scores = cache(lambda m: self._plain(m).score())
        if together:
            chosen = [self._intervals(intervals, lambda m: float(scores(m).sum()))] * len(columns)
        else:
            chosen = self._each_chosen(scores, rates, intervals)
        self.intervals: Indices = np.array(chosen, dtype=np.int64)

    def at(self, column: int, seconds: Array) -> Array:
        """(3, M) value, first and second derivative of a column at (M,) times."""
        return self._fit[column](int(self.intervals[column])).derivatives(seconds)[:, :, 0]

    def covariance(self, column: int, samples: slice, finer: int, checked: slice) -> tuple[Array, Array]:
        """As `CompiledSplines.covariance`."""
        fit, other = self._fit[column](int(self.intervals[column])), self._fit[column](finer)
        gains = fit.gains(self._piece(samples))
        places = self._piece(checked)
        difference = (fit.derivatives(places) - other.derivatives(places))[:, :, 0]
        # The spline spaces nearly contain one another: the difference varies by what the finer one varies more.
        excess = other.gains(places) * other.sigma**2 - fit.gains(places) * fit.sigma**2
        lag = np.mean(difference**2 - np.diagonal(excess, axis1=1, axis2=2).T, axis=1)
        return np.asarray(gains * fit.sigma**2), np.maximum(lag, 0.0)

    def _piece(self, part: slice) -> Array:
        """A part of the sample times, the same array each time, so that designs recognise it."""
        key = part.start, part.stop, part.step
        if key not in self._pieces:
            self._pieces[key] = self._at[part]
        return self._pieces[key]

    def _each_chosen(self, scores: Callable[[int], Array], rates: Array | None, given: int | None) -> list[int]:
        """Knot intervals of each column; columns follow their measured rates too where these are worth it."""
        score: list[Callable[[int], float]] = [partial(_entry, scores, k) for k in range(len(self._fit))]
        if given is not None:
            chosen = [given] * len(score)
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

    def _most(self) -> int:
        """Most knot intervals that still leave a third of the samples to judge by."""
        return max(len(self._at) * 2 // 3 - DEGREE, 1)

    def _intervals(self, given: int | None, score: Callable[[int], float]) -> int:
        return given if given is not None else self._rung(self._near(self._coarse(score), score))

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
