"""Stamps of a regular clock with jitter: the true sampling times, also with lost samples."""

import numpy as np
import scipy

from poise.types import Array, Mask

_MAX_JITTER, _LEAST_ALIKE = 0.27, 0.2
"""Periods of jitter, for which random stamps would have 0.29; or else the mean resultant length of the phases, for
which they have 0.03: stamps of arrival may be many periods late, in bursts."""
_ALIKE = 0.03
"""Share by which the mean step may differ from the median one without being tried as well."""
_LATE, _ROUNDS = 0.1, 6
"""Weight of stamps that come later than their tick, in the count of lost samples, and rounds of it."""
_BINS, _SMOOTH = 100, 31
"""Of the phases of stamps within a tick, and those over which their density is smoothed."""
_MOST_UNSURE, _BESIDE, _AROUND = 120, 2, 8
"""Samples in a row among which a gap is looked for, those on either side of it, and those before and after them, which
show how the values change."""
_MOVES, _MOST_ASKED, _MOST_LEFT_OUT = 0.1, 20_000, 0.3
"""Share of the fastest motion from which values show a tick; places that are asked at most; share of the samples whose
ticks may not be sure."""
_TOGETHER, _BRIEF, _BETTER = 40, 0.1, 0.5
"""Samples, and s, between gaps that may be one; share of the unevenness that another place of a gap leaves at most."""
_SHORT, _LONG = 128, 512
"""Samples for the coarse and the fine estimate of the period; `_SHORT` also for the mean phase."""


def regular_clock(seconds: Array, values: Array | None = None) -> Array | None:
    """(N,) the times of a clock that ticks evenly and drifts slowly, or None when no regular clock fits.

    NaN where samples are lost among late ones, so that their ticks are not sure.

    Samples are numbered by the phase of the clock. The mean over many stamps gives this phase even when single stamps
    are late, and a lost sample skips a number (counting rows or rounding differences fails with loss and jitter
    together). A line with slow drift (one knot in 10 s) is then fitted to the numbers.

    Args:
        seconds: (N,) stamps, ascending.
        values: (N, C) what was sampled: it shows where samples are lost among late ones.
    """
    steps = np.diff(seconds)
    if len(seconds) < 50 or not (steps > 0).all():
        return None
    period = _period(seconds)
    ticks = _numbered(seconds, period, values)
    fitted = _wandering(ticks, seconds)
    off = (seconds - fitted) / period
    if not (np.diff(fitted) > 0).all():
        return None
    if float(np.std(off)) <= _MAX_JITTER:
        return fitted
    unsure = np.zeros(len(ticks), bool) if values is None else _unsure(ticks, off, values)
    if abs(np.exp(2j * np.pi * off).mean()) < _LEAST_ALIKE or unsure.mean() > _MOST_LEFT_OUT:
        return None
    return np.where(unsure, np.nan, fitted)


def _phasors(seconds: Array, period: float, length: int) -> Array:
    """(W,) mean of exp(2 pi i t / period) over stretches of samples: of length one for even stamps."""
    turns = np.exp(2j * np.pi * (seconds - seconds[0]) / period)
    sizes = np.full(max(len(turns) // length, 1), len(turns) // max(len(turns) // length, 1))
    sizes[: len(turns) - int(sizes.sum())] += 1
    return np.asarray(np.add.reduceat(turns, np.concatenate([[0], np.cumsum(sizes[:-1])])) / sizes)


def _period(seconds: Array) -> float:
    """s, the period for which the stamps are most even; near the median step, or the mean one where bursts are many."""
    steps = np.diff(seconds)
    found = np.array([float(np.median(steps)), float(steps.mean())])
    found = found[:1] if abs(found[1] / found[0] - 1.0) < _ALIKE else found
    for length, reach in ((_SHORT, 0.1), (_LONG, 0.002)):
        tried = np.outer(found, 1.0 + np.arange(-reach, reach, 0.2 / length)).ravel()
        power = [float(np.sum(np.abs(_phasors(seconds, period, length)) ** 2)) for period in tried]
        found = tried[[int(np.argmax(power))]]
    return float(found[0])


def _numbered(seconds: Array, period: float, values: Array | None) -> Array:
    """(N,) tick numbers: the stamps rounded to the clock whose phase is followed from stretch to stretch."""
    phasors = _phasors(seconds, period, _SHORT)
    middles = np.array([part.mean() for part in np.array_split(seconds, len(phasors))])
    phase = np.interp(seconds, middles, np.unwrap(np.angle(phasors)) / (2.0 * np.pi))
    rows = np.arange(len(seconds))
    exact = (seconds - seconds[0]) / period - phase
    ticks = np.round(exact)
    # Stamps that are off by nearly half a period may fall on the same tick: never fewer ticks than samples.
    if (np.diff(ticks) >= 1.0).all():
        return np.asarray(ticks)
    if float(np.std(exact - ticks)) > _MAX_JITTER:
        # Stamps are late rather than early: a tick begins at the phase that the fewest stamps have.
        counts = np.histogram(exact % 1.0, _BINS, (0.0, 1.0))[0]
        density = np.convolve(np.tile(counts, 3), np.hanning(_SMOOTH + 2), "same")[_BINS : 2 * _BINS]
        ticks = np.floor(exact - (int(np.argmin(density)) + 0.5) / _BINS)
    lost, weights = ticks - rows, np.ones(len(rows))
    for _ in range(_ROUNDS):
        level = scipy.optimize.isotonic_regression(lost, weights=weights).x
        weights = np.where(lost - level > 0.5, _LATE, 1.0)
    numbered = np.asarray(np.round(level) + rows)
    if values is not None:
        for together in (0, min(_TOGETHER, int(_BRIEF / period))):
            numbered = _placed(numbered, ticks == numbered, values, together)
    return numbered


def _placed(ticks: Array, on_time: Mask, values: Array, together: int) -> Array:
    """The tick numbers (N,) with each gap between samples that are on time where values (N, C) are most even.

    A gap among late samples may be before or after each of them: stamps do not show it. Nor do they where a sample
    beside the gap is late by a tick, so that samples beside it are asked as well. Two gaps with no more
    samples between them than `together` may be one; 0: each gap alone.
    """
    ticks, sure = ticks.copy(), np.flatnonzero(on_time)
    gaps = np.flatnonzero(np.diff(ticks) > 1.0)
    pairs = np.column_stack([gaps, gaps] if not together else [gaps[:-1], gaps[1:]])
    first, last = pairs[pairs[:, 1] - pairs[:, 0] <= together].T
    before, after = np.searchsorted(sure, first - _BESIDE, side="right") - 1, np.searchsorted(sure, last + 1 + _BESIDE)
    kept = (before >= 0) & (after < len(sure))
    for begin, end in zip(sure[before[kept]], sure[after[kept]], strict=True):
        count = end - begin - 1
        if not 0 < count <= _MOST_UNSURE:
            continue
        early, late = ticks[begin] + np.arange(1, count + 1), ticks[end] - np.arange(count, 0, -1)
        one_gap = np.where(np.arange(count) < np.arange(count + 1)[:, None], early, late)
        tried = np.vstack([ticks[begin + 1 : end], one_gap])
        rows = slice(max(begin + 1 - _AROUND, 0), end + _AROUND)
        every = np.tile(ticks[rows], (len(tried), 1))
        every[:, begin + 1 - rows.start : end - rows.start] = tried
        uneven = _unevenness(every, values[rows])
        best = int(np.argmin(uneven))
        ticks[begin + 1 : end] = tried[best if uneven[best] < _BETTER * uneven[0] else 0]
    return ticks


def _unsure(ticks: Array, off: Array, values: Array) -> Mask:
    """(N,) samples beside or between places where values (N, C) are more even with other ticks.

    Other ticks are a gap that is shorter or longer, and a few samples that are a tick earlier or later.
    Asked at gaps, and where a stamp is later than the one before it by `off` (N,), in ticks.
    """
    unsure, places = np.ones(len(ticks), bool), np.array([], dtype=np.int64)
    unsure[_AROUND:-_AROUND] = False  # nothing is known beyond the ends
    moved = np.abs(values[2 * _AROUND - 1 :] - values[: 1 - 2 * _AROUND]).max(axis=1)
    step = np.diff(ticks) > 1.0
    asked = np.flatnonzero(
        (step | (np.abs(np.diff(off)) > 0.5))[_AROUND - 1 : 1 - _AROUND] & (moved > _MOVES * moved.max())
    )
    window = np.arange(2 * _AROUND) - _AROUND
    others = [n * (window >= 0) for n in (-1, 1, -2, 2, -4, 4)]
    others += [n * ((window >= 0) & (window < few)) for n in (-1, 1) for few in (1, 2, 4)]
    for some in np.array_split(asked[:: len(asked) // _MOST_ASKED + 1], len(asked) // 2000 + 1):
        rows = some[:, None] + window + _AROUND
        as_is = _unevenness(ticks[rows], values[rows])
        better = np.min([_unevenness(ticks[rows] + other, values[rows]) for other in others], axis=0)
        places = np.append(places, some[better < _BETTER * as_is])
    for some in np.split(places, np.flatnonzero(np.diff(places) > _TOGETHER) + 1):
        if len(some):
            unsure[some[0] : some[-1] + 2 * _AROUND] = True
    return unsure


def _unevenness(ticks: Array, values: Array) -> Array:
    """(K,) squares of what cubic polynomials over ticks (K, n) leave of values (n, C) or (K, n, C)."""
    middle, half = ticks.mean(axis=1, keepdims=True), np.ptp(ticks, axis=1)[:, None] / 2.0
    basis = np.linalg.qr(((ticks - middle) / half)[:, :, None] ** np.arange(4))[0]
    left = values - basis @ (np.swapaxes(basis, 1, 2) @ values)
    return np.asarray(np.sum(left**2, axis=(1, 2)))


def _wandering(ticks: Array, seconds: Array) -> Array:
    """(N,) least-squares line with linear B-splines of 10 s, twice: the second time without outliers."""
    knots = np.linspace(ticks[0], ticks[-1], max(int((seconds[-1] - seconds[0]) / 10.0), 1) + 1)
    place = np.clip(np.searchsorted(knots, ticks, side="right") - 1, 0, len(knots) - 2)
    share = (ticks - knots[place]) / (knots[place + 1] - knots[place])
    # About the straight line, so that the normal equations lose no digits.
    line = seconds[0] + (ticks - ticks[0]) * (seconds[-1] - seconds[0]) / (ticks[-1] - ticks[0])
    wanted = seconds - line
    kept = np.ones(len(ticks))
    fitted = seconds
    for _ in range(2):
        band, right = np.zeros((2, len(knots))), np.zeros(len(knots))
        for offset, weight in ((0, kept * (1.0 - share)), (1, kept * share)):
            right += np.bincount(place + offset, weight * wanted, len(knots))
            band[1] += np.bincount(place + offset, weight * (1.0 - share if offset == 0 else share), len(knots))
        band[0, 1:] = np.bincount(place, kept * share * (1.0 - share), len(knots))[:-1]
        level = scipy.linalg.solveh_banded(band + np.array([[0.0], [1e-12]]), right)
        fitted = line + (1.0 - share) * level[place] + share * level[place + 1]
        off = np.abs(seconds - fitted)
        kept = (off <= max(4.0 * 1.4826 * float(np.median(off)), 1e-7)).astype(np.float64)
    return np.asarray(fitted)
