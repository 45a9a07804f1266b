"""The level of the noise in a signal, the band that it fills, and the step that readings are rounded to."""

from dataclasses import dataclass
from math import comb

import numpy as np

from poise.types import Array

_STRETCH = 100
"""Differences in a stretch; the median over stretches counts."""
_BLOCKS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384)
"""Samples that are averaged to find the band of the noise."""
_FAST, _SLOWEST = 0.016, 0.08
"""s of a block: up to the first the loudest counts, since no motion is that fast; the second is the longest."""
_ALIKE = 0.5
"""Share of readings that equal the one before, from which their converter is coarse."""
_LOUDER = 1.25
"""Ratio of two levels from which they differ."""
_STEEP = 0.45
"""Exponent of the level over the length of a block from which the signal was filtered; first-order noise has 0.35."""
_LASTING = 3
"""Up to so many times the length of a block the level must last."""
_FEWEST = 60
"""Blocks for a level."""
_HEAVIEST = 1.8
"""Largest ratio of the spread of noise to its median: Student's t with three degrees of freedom has 1.5."""


@dataclass(frozen=True, eq=False)
class NoiseLevel:
    """The level of the noise inside its band, channel by channel.

    Args:
        sigma: (C,) one sigma of a sample of white noise with the same spectrum inside the band, in the signal's units.
        share: (C,) of that variance that the samples have: 1 for white noise, less where a filter removed a part.
        block: (C,) samples whose average has white noise again.
    """

    sigma: Array
    share: Array
    block: Array


def noise_level(values: Array, period: float, coarse: bool = True, least: Array | float = 0.0) -> NoiseLevel:
    """The level of the noise in (N, C) values, also of noise that a filter or an interpolation made smooth.

    Averages of white noise over b samples have a level of sigma / sqrt(b). Where the level of the averages times
    sqrt(b) grows steeply with b, the noise was filtered; the shortest blocks from which on it no longer does count.

    Args:
        values: the signal, or a residual.
        period: s between samples.
        coarse: see `white_level`.
        least: (C,) size of the noise of a sample, at the least; a signal without visible noise has it inside the band
            in which it is smaller.
    """
    lengths = [b for b in _BLOCKS if b == 1 or (b * period <= _SLOWEST * (1.0 + 1e-6) and len(values) // b >= _FEWEST)]
    levels = np.empty((len(lengths), values.shape[1]))
    for row, b in enumerate(lengths):
        means = values if b == 1 else block_means(values, b)
        levels[row] = _level(means, 3 if b == 1 else 5, coarse) * np.sqrt(b)
    # A line in the spectrum is louder in blocks of some lengths only, unlike noise.
    ends = np.searchsorted(lengths, _LASTING * np.array(lengths), side="right")
    for row in range(1, len(lengths)):
        levels[row] = levels[row : ends[row]].min(axis=0)
    chosen = np.zeros(values.shape[1], dtype=int)
    for row in range(1, len(lengths)):
        here, best = levels[row], levels[chosen, range(len(chosen))]
        steep = (chosen == row - 1) & (here > levels[row - 1] * (lengths[row] / lengths[row - 1]) ** _STEEP)
        fast = lengths[row] * period <= _FAST
        chosen[(here > _LOUDER * best) & fast | steep] = row
    columns, root = range(len(chosen)), np.sqrt(lengths)
    floor = np.broadcast_to(least, chosen.shape)
    for c in np.flatnonzero(levels[chosen, columns] < floor * root[chosen]):
        hidden = (levels[:, c] < floor[c] * root) & (levels[:, c] > levels[0, c] * np.power(lengths, _STEEP))
        chosen[c] = np.max(np.flatnonzero(hidden), initial=0)
    sigma = np.maximum(levels[chosen, columns], floor * root[chosen])
    inverse = 1.0 / np.array(lengths)
    share = np.array(
        [
            inverse[k] - np.diff(inverse[: k + 1]) @ np.minimum(levels[:k, c] / max(sigma[c], 1e-300), 1.0) ** 2
            for c, k in enumerate(chosen.tolist())
        ]
    )
    return NoiseLevel(sigma, share, np.array(lengths)[chosen])


def block_means(values: Array, block: int) -> Array:
    """(M, ...) means over `block` consecutive samples (N, ...); incomplete blocks are left out."""
    count = len(values) // block
    return np.asarray(values[: count * block].reshape(count, block, *values.shape[1:]).mean(axis=1))


def white_level(values: Array, coarse: bool = True) -> Array:
    """(C,) one sigma of white noise in (N, C), from third differences, which slow changes do not affect.

    The median over stretches of 100 samples, robust against bursts and quiet stretches.

    Args:
        values: the signal.
        coarse: the values may be rounded to a coarse grid; if not, knocks are distinguished from noise.
    """
    return _level(values, 3, coarse)


def _level(values: Array, order: int, coarse: bool) -> Array:
    """(C,) one sigma of white noise in (N, C), from differences of this order."""
    differences = np.abs(np.diff(values, n=order, axis=0)) / np.sqrt(comb(2 * order, order))
    count = max(len(differences) // _STRETCH, 1)
    stretches = differences[: len(differences) // count * count].reshape(count, -1, values.shape[1])
    found = np.median(1.4826 * np.median(stretches, axis=1), axis=0)
    spread = np.median(np.sqrt(np.mean(np.square(stretches), axis=1)), axis=0)
    if coarse:
        # Values on a coarse grid have differences of nearly zero: the spread is then the better measure. Knocks widen
        # the spread too, but leave the small differences as they are.
        low, middle = np.quantile(differences, [0.25, 0.5], axis=0)
        found = np.where((found > 0.3 * spread) | (low > 0.3 * middle), found, spread)
    heavy = (spread > 1.1 * found) & (spread < _HEAVIEST * found)
    return np.asarray(np.where(heavy, spread, found))


def lattice(values: Array) -> float:
    """The step of which all values are whole multiples, 0 when there is none.

    A grid that was rounded again to a much finer one still counts; readings at the largest magnitude may belong to a
    limit and do not count. On a grid many readings are equal, unlike those of a fine converter.

    Args:
        values: any shape; NaN are left out.
    """
    every = values[np.isfinite(values)]
    size = float(np.abs(every).max()) if len(every) else 0.0
    flat = every[np.abs(every) < size * (1.0 - 1e-9)]
    levels = _levels(flat, size)
    if len(levels) < 3:  # of so few, the largest is rather a level than a limit
        flat, levels = every, _levels(every, size)
    if len(levels) < 2 or len(levels) > 0.9 * len(flat):
        return 0.0
    gaps = np.diff(levels)
    finest = float(np.quantile(gaps, 0.1))
    if finest < 1e-6 * size:
        return 0.0
    counts = np.concatenate([[0.0], np.cumsum(np.round(gaps / finest))])
    step = float(np.polyfit(counts, levels, 1)[0])
    off = np.abs(levels / step - np.round(levels / step))
    return step if np.quantile(off, 0.99) < 0.04 else 0.0


def _levels(values: Array, size: float) -> Array:
    return np.asarray(np.unique(np.round(values / max(size, 1e-300), 10)) * size)


def rounding(values: Array) -> float:
    """One sigma of the rounding of values (any shape) to their `lattice`; 0 without one."""
    return float(lattice(values) / np.sqrt(12.0))


def coarse_steps(values: Array) -> Array:
    """(C,) the `lattice` of channels (N, C) in which most readings equal the one before; 0 of others.

    Noise of a third of a step makes readings differ; below that, rounding follows the load and is no noise.
    """
    alike = np.mean(np.diff(values, axis=0) == 0.0, axis=0) >= _ALIKE
    return np.array([lattice(column) if same else 0.0 for column, same in zip(values.T, alike.tolist(), strict=True)])


def wrench_rounding(wrench: Array) -> Array:
    """(6,) one sigma of the rounding of wrenches (N, 6), one step for forces and one for torques; 0 without."""
    return np.repeat([rounding(wrench[:, part]) for part in (slice(0, 3), slice(3, 6))], 3)
