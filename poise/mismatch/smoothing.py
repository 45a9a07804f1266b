"""Sampled positions to position, velocity and acceleration at other stamps, by splines that choose their knots."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.mismatch.clocks import regular
from poise.robot.splines import Grid, SplineFit

Array = NDArray[np.float64]

GAP = 6.0
"""Median sample intervals that make a gap."""
MIN_SAMPLES = 30
EDGE = 0.08
"""s at the ends of a stretch where accelerations are too uncertain."""
SPACINGS = tuple(0.02 * 2 ** (k / 2) for k in range(11))
"""s between knots that are tried: 0.02 to 0.64."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Values (N, J), rates and second rates at the wanted times; NaN where the samples do not reach.

    Args:
        known: (N,) where there are values.
        jitter: s, one sigma of the stamps' error that was taken out; 0 when they were used as they are.
        noise: (J,) one sigma of a sample about the spline.
    """

    position: Array
    velocity: Array
    acceleration: Array
    known: NDArray[np.bool_]
    jitter: float
    noise: Array


def smooth(seconds: Array, values: Array, wanted: Array) -> Smoothed:
    """Differentiate samples and evaluate at other times, never across a gap.

    The stamps are taken as they are or as those of a regular clock with jitter, whichever the splines follow better.

    Args:
        seconds: (M,) not descending.
        values: (M, J) finite.
        wanted: (N,).

    Raises:
        InputError: TOO_FEW_SAMPLES.
    """
    fresh = np.concatenate([[True], np.diff(seconds) > 0])
    seconds, values = seconds[fresh], values[fresh]
    even = regular(seconds)
    jitter = 0.0
    if even is not None:
        raw, better = (_roughness(stamps, values) for stamps in (seconds, even))
        if better < raw:
            jitter, seconds = float(np.std(seconds - even)), even
    out = np.full((3, len(wanted), values.shape[1]), np.nan)
    noise = np.zeros(values.shape[1])
    for part in _stretches(seconds):
        begin, end = seconds[part][0], seconds[part][-1]
        inside = (wanted >= begin + EDGE) & (wanted <= end - EDGE)
        for columns, fit in _best(seconds[part], values[part]):
            noise[columns] = np.maximum(noise[columns], fit.sigma[columns])
            for order in range(3):
                out[order][np.ix_(inside, columns)] = fit(wanted[inside], order)[:, columns]
    return Smoothed(out[0], out[1], out[2], np.isfinite(out).all(axis=(0, 2)), jitter, noise)


def _best(seconds: Array, values: Array) -> list[tuple[NDArray[np.intp], SplineFit]]:
    """Columns with the spline whose knots suit them best (generalised cross-validation, column by column)."""
    span = float(seconds[-1] - seconds[0])
    sizes = sorted({max(round(span / spacing), 1) for spacing in SPACINGS})
    most = max(len(seconds) * 2 // 3 - 5, 1)
    fits = [SplineFit(Grid.across(seconds, size), seconds, values) for size in sizes if size <= most]
    chosen = np.argmin([fit.score() for fit in fits], axis=0)
    return [(np.flatnonzero(chosen == i), fits[i]) for i in np.unique(chosen)]


def _roughness(seconds: Array, values: Array) -> float:
    """How badly smooth splines follow the samples with these stamps (log, summed over the columns that move)."""
    stretch = max(_stretches(seconds), key=lambda part: part.stop - part.start)
    part = slice(stretch.start, min(stretch.stop, stretch.start + 1500))
    moving = np.ptp(values[part], axis=0) > 1e-4
    if not moving.any():
        return 0.0
    size = max(round((seconds[part][-1] - seconds[part][0]) / 0.1), 1)
    sigma = SplineFit(Grid.across(seconds[part], size), seconds[part], values[part][:, moving]).sigma
    return float(np.log(np.maximum(sigma, 1e-12)).sum())


def _stretches(seconds: Array) -> list[slice]:
    steps = np.diff(seconds)
    limit = GAP * float(np.median(steps)) if len(steps) else 0.0
    edges = [0, *(np.flatnonzero(steps > limit) + 1).tolist(), len(seconds)]
    found = [slice(a, b) for a, b in itertools.pairwise(edges) if b - a >= MIN_SAMPLES]
    if not found:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"too few joint samples: of {len(seconds)} no {MIN_SAMPLES} come without a gap of {limit:.3g} s; "
            "record at 50 Hz or more, for ten seconds or more",
        )
    return found
