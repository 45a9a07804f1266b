"""The level of white noise in a signal, and the step that its readings are rounded to."""

import numpy as np

from poise.types import Array


def white_level(values: Array, coarse: bool = True) -> Array:
    """(C,) one sigma of white noise in (N, C), from third differences, which slow changes do not affect.

    The median over stretches of 100 samples, robust against bursts and quiet stretches.

    Args:
        values: the signal.
        coarse: the values may be rounded to a coarse grid; if not, knocks are distinguished from noise.
    """
    differences = np.diff(values, n=3, axis=0) / np.sqrt(20.0)
    length = 100
    count = max(len(differences) // length, 1)
    stretches = np.array_split(np.abs(differences), count)
    levels = np.array([1.4826 * np.median(part, axis=0) for part in stretches])
    found = np.median(levels, axis=0)
    if not coarse:
        return np.asarray(found)
    spread = np.median([np.sqrt(np.mean(np.square(part), axis=0)) for part in stretches], axis=0)
    # Values on a coarse grid have differences of nearly zero: the spread is then the better measure. Knocks widen
    # the spread too, but leave the small differences as they are.
    low, middle = np.quantile(np.abs(differences), [0.25, 0.5], axis=0)
    return np.asarray(np.where((found > 0.3 * spread) | (low > 0.3 * middle), found, spread))


def lattice(values: Array) -> float:
    """The step of which all values are whole multiples, 0 when there is none.

    A grid that was rounded again to a much finer one still counts; readings at the largest magnitude may belong to a
    limit and do not count. On a grid many readings are equal, unlike those of a fine converter.

    Args:
        values: any shape; NaN are left out.
    """
    flat = values[np.isfinite(values)]
    size = float(np.abs(flat).max()) if len(flat) else 0.0
    flat = flat[np.abs(flat) < size * (1.0 - 1e-9)]
    levels = np.unique(np.round(flat / max(size, 1e-300), 10)) * size
    if len(levels) < 3 or len(levels) > 0.9 * len(flat):
        return 0.0
    gaps = np.diff(levels)
    finest = float(np.quantile(gaps, 0.1))
    if finest < 1e-6 * size:
        return 0.0
    counts = np.concatenate([[0.0], np.cumsum(np.round(gaps / finest))])
    step = float(np.polyfit(counts, levels, 1)[0])
    off = np.abs(levels / step - np.round(levels / step))
    return step if np.quantile(off, 0.99) < 0.04 else 0.0
