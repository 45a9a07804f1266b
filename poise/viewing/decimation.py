"""Fewer points, same picture: long series thinned so that every spike stays visible."""

import itertools

import numpy as np

from poise.types import Array

_GAP = 10.0
"""A pause longer than this many median sample times is a gap: a line across it would be invented."""


def envelope(x: Array, y: Array, bins: int) -> tuple[Array, Array]:
    """Thin a series to the first, least, greatest and last sample of each of `bins` stretches, in order.

    What is drawn on `bins` columns of pixels looks the same: no extremum is lost, none is made up.
    One NaN of a stretch is kept, so that a broken line stays broken.

    Args:
        x: (N,) rising.
        y: (N,) values, NaN where the line breaks.
        bins: stretches of equal numbers of samples, 1 or more.

    Returns:
        x (M,), y (M,) with M <= 5 bins; the input itself when it is already that short.
    """
    if len(y) <= 5 * bins:
        return x, y
    edges = np.linspace(0, len(y), bins + 1).astype(int)
    keep: set[int] = set()
    for first, end in itertools.pairwise(edges):
        part = y[first:end]
        known = np.flatnonzero(np.isfinite(part))
        if len(known):
            chosen = {known[0], known[-1], known[np.argmin(part[known])], known[np.argmax(part[known])]}
            keep.update(int(first + index) for index in chosen)
        if len(known) < len(part):
            keep.add(int(first + np.flatnonzero(~np.isfinite(part))[0]))
    index = np.array(sorted(keep))
    return x[index], y[index]


def break_at_gaps(x: Array, y: Array) -> tuple[Array, Array]:
    """Put a NaN into every pause of a series, so that no line is drawn across it.

    Args:
        x: (N,) rising.
        y: (N,) values.

    Returns:
        x and y, longer by one sample per gap.
    """
    if len(x) < 3:
        return x, y
    steps = np.diff(x)
    gaps = np.flatnonzero(steps > _GAP * np.median(steps))
    middles = (x[gaps] + x[gaps + 1]) / 2
    return np.insert(x, gaps + 1, middles), np.insert(y, gaps + 1, np.nan)
