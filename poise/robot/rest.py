"""Where a sampled signal stands still: statistical tests that its mean does not change."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from poise.geometry import runs
from poise.types import Array, Mask

_BIN_SECONDS, _BIN_SAMPLES = 0.05, 8
"""Samples are averaged over bins of this length, or of this many samples if that is longer."""
_BINS = 4
"""Bins in a row whose means must agree."""
_LOCAL_LIMIT = 16.3
"""Quantile 0.999 of chi square with three degrees of freedom, for the means of four bins."""
_SIGMAS = 4.0
"""One-sigma errors by which a whole stretch may differ from a constant."""
_STEP = 5.0
"""Encoder steps, or sigmas of noise: neighbouring levels closer than this are a slow motion, not two rests."""
_SHORTEST = 1.5
"""Knot spacings; shorter stretches without motion are turning points."""
_MARGIN = 3.0
"""Knot spacings between a rest and motion: half the width of a quintic B-spline."""
_EQUAL, _REGULAR, _OFTEN = 1e-12, 0.02, 0.99
"""Difference of two equal samples, as a share of the largest one; how near a difference is to a multiple of the step of
an encoder, in steps, and for which share of them it must be."""
_QUANTISED_COUNT = 12.0
"""Independent samples that a constant quantised reading is worth, however long it lasts."""


@dataclass(frozen=True)
class Rest:
    """A stretch of samples `begin` to `end` (excluded) at one level.

    Args:
        begin, end: sample indices.
        level: mean of the samples.
        sigma: (3,) one-sigma errors of position, velocity and acceleration: those of a quadratic through the stretch.
    """

    begin: int
    end: int
    level: float
    sigma: tuple[float, float, float]


def find_rests(seconds: Array, values: Array, spacing: Array) -> list[list[Rest]]:
    """Stretches of each signal at rest.

    A stretch is at rest when the means of its bins agree with a constant, locally and as a whole, and show neither
    trend nor curvature. Levels that follow each other in small steps are a slow motion that a quantised encoder shows
    as a staircase; they are not at rest.

    Args:
        seconds: (N,) not descending.
        values: (N, J) rad or m.
        spacing: (J,) s between the knots of the spline that suits the motion. Stretches of less than 1.5 of them are
            turning points. A rest keeps `_MARGIN` of them away from motion: motion shows in the noise some time after
            it began.
    """
    period = float(seconds[-1] - seconds[0]) / max(len(seconds) - 1, 1)
    size = max(_BIN_SAMPLES, round(_BIN_SECONDS / period)) if period > 0 else _BIN_SAMPLES
    count = len(values) // size
    if count < _BINS:
        return [[] for _ in spacing]
    columns = np.ascontiguousarray(values.T)
    rows = columns[:, : count * size].reshape(-1, count, size)
    bins = _Bins(rows.mean(axis=2), rows.var(axis=2, ddof=1), size, period)
    quiet = _lower_quartile(_about_line(seconds[: count * size].reshape(count, size), rows))
    quiet /= _quartile_share(size - 2)
    step = encoder_step(columns)
    rounding = np.finfo(np.float64).eps * np.abs(bins.means).max(axis=1)
    noise = np.maximum.reduce([quiet, step**2 / 12.0, rounding**2, np.full(len(step), 1e-300)])
    agree = sliding_window_view(bins.means, _BINS, axis=1).var(axis=2) * _BINS * size <= _LOCAL_LIMIT * noise[:, None]
    return [
        _rests_of(seconds, columns[k], bins.column(k), agree[k], float(spacing[k]), float(noise[k]), float(step[k]))
        if agree[k].any()
        else []
        for k in range(len(columns))
    ]


@dataclass(frozen=True)
class _Bins:
    """Means and variances of the samples of bins, (J, B) or (B,), samples in a bin, and s between samples."""

    means: Array
    variances: Array
    size: int
    period: float

    def column(self, k: int) -> "_Bins":
        return replace(self, means=self.means[k], variances=self.variances[k])


def _rests_of(
    seconds: Array, values: Array, bins: _Bins, agree: Mask, spacing: float, noise: float, step: float
) -> list[Rest]:
    """Of one signal (N,), whose means agree with a constant over the `_BINS` bins that begin where `agree` says."""
    size, last = bins.size, len(bins.means)
    shortest = min(_SHORTEST * spacing, 0.8 * float(seconds[-1] - seconds[0]))
    found = [
        (a, b)
        for a, b in _constant_runs(bins.means, bins.variances, agree, noise, size)
        if (b - a) * size * bins.period >= shortest
    ]
    creeping = _are_stairs(
        [float(bins.means[a:b].mean()) for a, b in found], [(b - a) * size for a, b in found], noise, step
    )
    away = math.ceil(_MARGIN * spacing / bins.period)
    bounds = [
        (a * size + away if a else 0, b * size - away if b < last else len(values))
        for (a, b), slow in zip(found, creeping, strict=True)
        if not slow
    ]
    return [_rest(seconds, values, (begin, end), noise, step) for begin, end in bounds if end - begin >= size]


def _constant_runs(means: Array, variances: Array, agree: Mask, noise: float, size: int) -> list[tuple[int, int]]:
    """Runs of bins, first and last plus one, at one level; short interruptions that fit the level are part of a run."""
    still = np.zeros(len(means), dtype=bool)
    limit = 1.5 * noise * (1.0 + _SIGMAS * np.sqrt(2.0 / (size - 1)))
    for first in np.flatnonzero(agree):
        still[first : first + _BINS] |= (variances[first : first + _BINS] <= limit).all()
    level: list[tuple[int, int]] = []
    for a, last in runs(still):
        b = last + 1
        gap = slice(level[-1][1] if level else a, a)
        near = bool(level) and a - gap.start <= _BINS and bool((variances[gap] <= 2.0 * limit).all())
        if near and _is_constant(means[level[-1][0] : b], noise / size):
            level[-1] = level[-1][0], b
        else:
            level.append((a, b))
    return [(a, b) for a, b in level if _is_constant(means[a:b], noise / size)]


def _are_stairs(levels: list[float], counts: list[int], noise: float, step: float) -> list[bool]:
    """Which levels, means of so many samples, lie one small but significant step from a neighbouring one."""
    if len(levels) < 2:
        return [False] * len(levels)
    apart, inverse = np.abs(np.diff(levels)), 1.0 / np.array(counts)
    close = apart < _STEP * max(step, np.sqrt(noise))
    close &= apart > _SIGMAS * np.sqrt(noise * (inverse[1:] + inverse[:-1]))
    return list(np.concatenate([close, [False]]) | np.concatenate([[False], close]))


def _quartile_share(freedom: int) -> float:
    """Lower quartile of chi square over its degrees of freedom (Wilson and Hilferty 1931)."""
    spread = 2.0 / (9.0 * freedom)
    return float((1.0 - spread - 0.6745 * np.sqrt(spread)) ** 3)


def _lower_quartile(values: Array) -> Array:
    """(J,) the 25th percentile of (J, B), between samples where need be, as `np.percentile` has it but faster."""
    ordered = np.sort(values, axis=1)
    place = 0.25 * (values.shape[1] - 1)
    below = int(place)
    if below == place:
        return ordered[:, below]
    low, high, share = ordered[:, below], ordered[:, below + 1], place - below
    return np.asarray(low + (high - low) * share if share < 0.5 else high - (high - low) * (1 - share))


def _about_line(times: Array, rows: Array) -> Array:
    """(J, B) variance of the samples (J, B, S) of each bin about a line, at times (B, S)."""
    time, off = times - times.mean(axis=1, keepdims=True), rows - rows.mean(axis=2, keepdims=True)
    square = np.maximum(np.sum(time**2, axis=1), 1e-30)
    left = np.sum(off**2, axis=2) - np.sum(time * off, axis=2) ** 2 / square
    return np.asarray(np.maximum(left, 0.0) / (rows.shape[2] - 2))


def _is_constant(means: Array, variance: float) -> bool:
    """Whether bin means (B,) with this variance fit a constant, and have neither trend nor curvature."""
    count = len(means)
    off = means - means.mean()
    trend = np.arange(count) - (count - 1) / 2
    bend = trend**2 - np.mean(trend**2)
    for shape in (trend, bend):
        if abs(float(shape @ off)) > _SIGMAS * np.sqrt(variance * float(shape @ shape)):
            return False
    freedom = count - 1
    return bool(off @ off <= variance * (freedom + _SIGMAS * np.sqrt(2.0 * freedom) + 6.0))


def encoder_step(values: Array) -> Array:
    """(J,) resolution of quantised signals (J, N): all differences are multiples of the smallest; else 0."""
    steps = np.abs(np.diff(values, axis=1))
    moves = steps > _EQUAL * np.maximum(np.abs(values).max(axis=1), 1e-300)[:, None]
    least = np.min(steps, axis=1, where=moves, initial=np.inf)
    counts = steps / least[:, None]
    regular = np.mean(np.abs(counts - np.round(counts)) < _REGULAR, axis=1) > _OFTEN
    return np.where(moves.any(axis=1) & regular, least, 0.0)


def _rest(seconds: Array, values: Array, bounds: tuple[int, int], noise: float, step: float) -> Rest:
    part = slice(*bounds)
    length = max(float(seconds[part][-1] - seconds[part][0]), 1e-9)
    count = float(bounds[1] - bounds[0])
    if step > 0 and np.ptp(values[part]) == 0:
        count = min(count, _QUANTISED_COUNT)
    scale = np.sqrt(noise / count)
    # Standard errors of the mean, the slope and twice the curvature of a quadratic through evenly spaced samples.
    sigma = float(scale), float(scale * np.sqrt(12.0) / length), float(scale * np.sqrt(720.0) / length**2)
    return Rest(bounds[0], bounds[1], float(values[part].mean()), sigma)
