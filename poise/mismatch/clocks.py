"""Stamps of a regular clock that came with jitter: when the samples were really taken, through lost samples."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAX_JITTER = 0.25
"""Periods; with more of it a late sample cannot be told from a lost one."""


def regular(seconds: Array) -> Array | None:
    """(N,) the times of a clock that ticks evenly and drifts slowly, or None when the stamps are not like that.

    Samples are numbered by following the clock from tick to tick (a lost sample skips a number; counting rows or
    rounding differences does not survive loss and jitter together); a line with a slow wander (one knot in 10 s) is
    then fitted to the numbers.
    """
    steps = np.diff(seconds)
    if len(seconds) < 50 or not (steps > 0).all():
        return None
    period = float(np.median(steps))
    ticks = _numbered(seconds, period)
    if (np.diff(ticks) < 1).any():
        return None
    fitted = _wandering(ticks, seconds)
    jitter = float(np.std(seconds - fitted))
    if jitter > MAX_JITTER * period or not (np.diff(fitted) > 0).all():
        return None
    return fitted


def _numbered(seconds: Array, period: float) -> Array:
    """(N,) tick numbers by a second-order phase-locked loop: phase and period are corrected at every sample."""
    ticks = np.empty(len(seconds))
    at, tick, step = float(seconds[0]), 0.0, period
    for i, stamp in enumerate(seconds.tolist()):
        ahead = max(round((stamp - at) / step), 0 if i == 0 else 1)
        tick += ahead
        at += ahead * step
        error = min(max(stamp - at, -period), period)
        at += 0.1 * error
        step = min(max(step + 0.002 * error, 0.9 * period), 1.1 * period)
        ticks[i] = tick
    return ticks


def _wandering(ticks: Array, seconds: Array) -> Array:
    """(N,) least-squares line with hat functions of 10 s, twice: stamps that are far off do not pull."""
    knots = np.linspace(ticks[0], ticks[-1], max(int((seconds[-1] - seconds[0]) / 10.0), 1) + 1)
    place = np.clip(np.searchsorted(knots, ticks, side="right") - 1, 0, len(knots) - 2)
    share = (ticks - knots[place]) / (knots[place + 1] - knots[place])
    basis = np.zeros((len(ticks), len(knots)))
    rows = np.arange(len(ticks))
    basis[rows, place], basis[rows, place + 1] = 1.0 - share, share
    kept = np.ones(len(ticks), dtype=bool)
    fitted = seconds
    for _ in range(2):
        level = np.linalg.lstsq(basis[kept], seconds[kept] - seconds[0], rcond=None)[0]
        fitted = basis @ level + seconds[0]
        off = np.abs(seconds - fitted)
        kept = off <= max(4.0 * 1.4826 * float(np.median(off)), 1e-7)
    return np.asarray(fitted)
