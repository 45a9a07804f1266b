"""Where a sampled signal stands still: statistical tests that its mean does not change."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from poise.types import Array

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


def find_rests(seconds: Array, values: Array, spacing: float) -> list[Rest]:
    """Stretches of one signal at rest.

    A stretch is at rest when the means of its bins agree with a constant, locally and as a whole, and show neither
    trend nor curvature. Levels that follow each other in small steps are a slow motion that a quantised encoder shows
    as a staircase; they are not at rest.

    Args:
        seconds: (N,) not descending.
        values: (N,) rad or m.
        spacing: s between the knots of the spline that suits the motion. Stretches of less than 1.5 of them are turning
            points. A rest keeps `_MARGIN` of them away from motion: motion shows in the noise some time after it began.
    """
    period = float(seconds[-1] - seconds[0]) / max(len(seconds) - 1, 1)
    size = max(_BIN_SAMPLES, round(_BIN_SECONDS / period)) if period > 0 else _BIN_SAMPLES
    bins = len(values) // size
    if bins < _BINS:
        return []
    rows, times = values[: bins * size].reshape(bins, size), seconds[: bins * size].reshape(bins, size)
    means, step = rows.mean(axis=1), _encoder_step(values)
    quiet = _lower_quartile(_about_line(times, rows)) / _quartile_share(size - 2)
    rounding = float(np.finfo(np.float64).eps * np.abs(means).max())
    noise = max(quiet, step**2 / 12.0, rounding**2, 1e-300)
    shortest = min(_SHORTEST * spacing, 0.8 * float(seconds[-1] - seconds[0]))
    found = [
        (a, b)
        for a, b in _constant_runs(means, rows.var(axis=1, ddof=1), noise, size)
        if (b - a) * size * period >= shortest
    ]
    creeping = _are_stairs(
        [float(means[a:b].mean()) for a, b in found], [(b - a) * size for a, b in found], noise, step
    )
    away = math.ceil(_MARGIN * spacing / period)
    bounds = [
        (a * size + away if a else 0, b * size - away if b < bins else len(values))
        for (a, b), slow in zip(found, creeping, strict=True)
        if not slow
    ]
    return [_rest(seconds, values, (begin, end), noise, step) for begin, end in bounds if end - begin >= size]


def _constant_runs(means: Array, variances: Array, noise: float, size: int) -> list[tuple[int, int]]:
    """Runs of bins, first and last plus one, at one level; short interruptions that fit the level are part of a run."""
    still = np.zeros(len(means), dtype=bool)
    agree = sliding_window_view(means, _BINS).var(axis=1) * _BINS * size <= _LOCAL_LIMIT * noise
    limit = 1.5 * noise * (1.0 + _SIGMAS * np.sqrt(2.0 / (size - 1)))
    for first in np.flatnonzero(agree):
        still[first : first + _BINS] |= (variances[first : first + _BINS] <= limit).all()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    runs: list[tuple[int, int]] = []
    for a, b in edges.reshape(-1, 2).tolist():
        gap = slice(runs[-1][1] if runs else a, a)
        near = bool(runs) and a - gap.start <= _BINS and bool((variances[gap] <= 2.0 * limit).all())
        if near and _is_constant(means[runs[-1][0] : b], noise / size):
            runs[-1] = runs[-1][0], b
        else:
            runs.append((a, b))
    return [(a, b) for a, b in runs if _is_constant(means[a:b], noise / size)]


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


def _lower_quartile(values: Array) -> float:
    """The 25th percentile of (B,), between samples where need be, as `np.percentile` has it but ten times faster."""
    ordered = np.sort(values)
    place = 0.25 * (len(ordered) - 1)
    below = int(place)
    if below == place:
        return float(ordered[below])
    low, high, share = ordered[below], ordered[below + 1], place - below
    return float(low + (high - low) * share if share < 0.5 else high - (high - low) * (1 - share))


def _about_line(times: Array, rows: Array) -> Array:
    """(B,) variance of the samples (B, S) of each bin about a line."""
    time, off = times - times.mean(axis=1, keepdims=True), rows - rows.mean(axis=1, keepdims=True)
    square = np.maximum(np.sum(time**2, axis=1), 1e-30)
    left = np.sum(off**2, axis=1) - np.sum(time * off, axis=1) ** 2 / square
    return np.asarray(np.maximum(left, 0.0) / (rows.shape[1] - 2))


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


def _encoder_step(values: Array) -> float:
    """Resolution of a quantised signal; 0 when consecutive samples are hardly ever equal."""
    steps = np.abs(np.diff(values))
    positive = steps[steps > 1e-12 * max(float(np.abs(values).max()), 1e-300)]
    return float(positive.min()) if 0 < len(positive) < 0.8 * len(steps) else 0.0


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
