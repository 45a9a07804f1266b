"""Where a sampled signal stands still: statistical tests that its mean does not change."""

from dataclasses import dataclass

import numpy as np

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


def find_rests(seconds: Array, values: Array) -> list[Rest]:
    """Stretches of one signal at rest.

    A stretch is at rest when the means of its bins agree with a constant, locally and as a whole, and show no trend.
    Levels that follow each other in small steps are a slow motion that a quantised encoder shows as a staircase; they
    are not at rest.

    Args:
        seconds: (N,) not descending.
        values: (N,) rad or m.
    """
    period = float(seconds[-1] - seconds[0]) / max(len(seconds) - 1, 1)
    size = max(_BIN_SAMPLES, round(_BIN_SECONDS / period)) if period > 0 else _BIN_SAMPLES
    bins = len(values) // size
    if bins < _BINS:
        return []
    rows, times = values[: bins * size].reshape(bins, size), seconds[: bins * size].reshape(bins, size)
    means = rows.mean(axis=1)
    variances, detrended = rows.var(axis=1, ddof=1), _about_line(times, rows)
    step = _encoder_step(values)
    noise = max(float(np.percentile(detrended, 25)) / _quartile_share(size - 2), step**2 / 12.0)
    if noise == 0.0:
        noise = max(float(np.finfo(np.float64).eps * np.abs(means).max()) ** 2, 1e-300)
    still = np.zeros(bins, dtype=bool)
    windows = np.lib.stride_tricks.sliding_window_view(means, _BINS)
    agree = windows.var(axis=1) * _BINS * size <= _LOCAL_LIMIT * noise
    quiet = variances <= noise * (1.0 + _SIGMAS * np.sqrt(2.0 / (size - 1))) * 1.5
    for first in np.flatnonzero(agree):
        still[first : first + _BINS] |= quiet[first : first + _BINS].all()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    found = [(a, b) for a, b in edges.reshape(-1, 2) if _is_constant(means[a:b], noise / size)]
    if not found:
        return []
    limit = _STEP * max(step, np.sqrt(noise))
    levels = np.array([means[a:b].mean() for a, b in found])
    apart, counts = np.abs(np.diff(levels)), np.array([(b - a) * size for a, b in found])
    close = (apart < limit) & (apart > _SIGMAS * np.sqrt(noise * (1.0 / counts[1:] + 1.0 / counts[:-1])))
    slow = np.concatenate([close, [False]]) | np.concatenate([[False], close])
    return [
        _rest(seconds, values, (a * size, len(values) if b == bins else b * size), noise, step)
        for (a, b), creeping in zip(found, slow, strict=True)
        if not creeping
    ]


def _quartile_share(freedom: int) -> float:
    """Lower quartile of chi square over its degrees of freedom (Wilson and Hilferty 1931)."""
    spread = 2.0 / (9.0 * freedom)
    return float((1.0 - spread - 0.6745 * np.sqrt(spread)) ** 3)


def _about_line(times: Array, rows: Array) -> Array:
    """(B,) variance of the samples (B, S) of each bin about a line."""
    time, off = times - times.mean(axis=1, keepdims=True), rows - rows.mean(axis=1, keepdims=True)
    square = np.maximum(np.sum(time**2, axis=1), 1e-30)
    left = np.sum(off**2, axis=1) - np.sum(time * off, axis=1) ** 2 / square
    return np.asarray(np.maximum(left, 0.0) / (rows.shape[1] - 2))


def _is_constant(means: Array, variance: float) -> bool:
    """Whether bin means (B,) with this variance fit a constant, and have no trend."""
    count = len(means)
    off = means - means.mean()
    time = np.arange(count) - (count - 1) / 2
    trend = float(time @ off) / np.sqrt(variance * float(time @ time))
    freedom = count - 1
    return bool(abs(trend) <= _SIGMAS and off @ off <= variance * (freedom + _SIGMAS * np.sqrt(2.0 * freedom) + 6.0))


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
