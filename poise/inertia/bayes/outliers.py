"""Blocks that no payload explains, because something else touched it; and noise that is more than was said."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.inertia.bayes.lasting import MEAN_UNKNOWNS, variance_of_sum
from poise.inertia.model import residual_moments
from poise.types import Array, Mask

UNLIKELY = 6.0
"""Standard deviations at which a block is held for a push; noise comes there once in a billion."""

_NOTABLE = 4.0
"""Standard errors at which more noise than was said counts as that, and not as chance."""

_ENOUGH_BLOCKS = 12
"""From this many on, means over blocks show whether errors are correlated in time."""

_SLOW_NOTABLE = 3.0
"""The same for errors that are correlated in time."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """What an answer leaves of blocks, in units of what was expected.

    Args:
        surprise: (B,) of all six channels, as a number of standard deviations.
        variance_ratio: (B, 2) mean square of force and torque.
        mean_ratio: (B, 2) the same of block means, times the samples in a block: 1 for white noise.
        squares: (B, 2) sum of squares of force and torque, N^2 and (N m)^2.
        means: (B, 6) N and N m.
    """

    surprise: Array
    variance_ratio: Array
    mean_ratio: Array
    squares: Array
    means: Array


def residuals(moments: Array, sizes: NDArray[np.int64], unknowns: Array, covariance: Array) -> Residuals:
    """Compare blocks with an answer.

    Args:
        moments: (B, 19, 19) sums over samples, see `signals`.
        sizes: (B,) samples.
        unknowns: (16,) the answer.
        covariance: (6, 6) expected of a residual.
    """
    second, first = residual_moments(moments, unknowns)
    squared = np.einsum("bij,ij->b", second, np.linalg.inv(covariance))
    # Wilson and Hilferty 1931: the cube root of chi-square per degree of freedom is nearly normal.
    freedom = 6.0 * sizes
    spread = 2 / (9 * freedom)
    surprise = (np.cbrt(squared.clip(min=0.0) / freedom) - 1 + spread) / np.sqrt(spread)
    variance, mean, squares = (np.empty((len(sizes), 2)) for _ in range(3))
    for group, rows in enumerate((slice(0, 3), slice(3, 6))):
        inverse = np.linalg.inv(covariance[rows, rows])
        variance[:, group] = np.einsum("bij,ij->b", second[:, rows, rows], inverse) / (3 * sizes)
        mean[:, group] = np.einsum("bi,ij,bj->b", first[:, rows], inverse, first[:, rows]) / (3 * sizes)
        squares[:, group] = np.trace(second[:, rows, rows], axis1=1, axis2=2).clip(min=0.0)
    return Residuals(surprise, variance, mean, squares, first / sizes[:, None])


def sample_excess(found: Residuals, sizes: NDArray[np.int64], free: Mask) -> Array:
    """(2,) by how much more force and torque vary from sample to sample than expected; 1 where chance explains it.

    The median over the blocks that are `free` (B,) of contact, which a short push does not move.
    """
    freedom = 3 * sizes[free].mean()
    median = np.median(found.variance_ratio[free], axis=0) / (1 - 2 / (9 * freedom)) ** 3
    by_chance = 1.25 * np.sqrt(2 / (freedom * free.sum()))
    return np.where(np.abs(median - 1) > _NOTABLE * by_chance, median, 1.0)


def mean_excess(found: Residuals, sizes: NDArray[np.int64], keep: Mask) -> Array:
    """(2,) mean square of force and torque in the blocks that are kept (B,), in units of what was expected; at least 1.

    The median of `sample_excess` has less than the mean where the noise has heavy tails, and its dead band hides up to
    a sixth of a variance. The answer errs by the mean.
    """
    weights = sizes[keep] / sizes[keep].sum()
    return np.asarray(np.maximum(weights @ found.variance_ratio[keep], 1.0))


def slow_excess(found: Residuals, usable: Mask, correlation: Array) -> Array:
    """(2,) by how much more slow errors vary than white noise lets expect; 1 where chance explains it.

    Errors that are correlated in time (a filtered or vibrating sensor, a model that does not fit) make means over
    blocks vary more, and neighbouring means alike. Parameters change no faster than those means, so that the variance
    of their sum counts.

    Args:
        found: of all blocks.
        usable: (B,) blocks.
        correlation: (2,) of neighbouring means, of force and torque.
    """
    count = int(usable.sum())
    if count < _ENOUGH_BLOCKS:
        return np.ones(2)
    freedom = 3 * count - MEAN_UNKNOWNS
    means = found.mean_ratio[usable].sum(axis=0) * 3 / freedom
    together = means * variance_of_sum(correlation)
    by_chance = np.sqrt(2 / freedom + 4 / (3 * count))
    return np.where(together > 1 + _SLOW_NOTABLE * by_chance, together, 1.0)
