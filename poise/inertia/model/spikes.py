"""Spikes: one or two samples far from those on both sides, by a converter or by an error of transmission."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from poise.types import Array, Mask

SPIKE = "spike"
"""Reason of rejection, as in poise_msgs/RejectedInterval."""

_SIDE, _BLOCK = 2, 32
"""Samples on either side whose median a sample is compared with; and of a block that shows what is usual."""

_USUAL, _CORE, _QUANTA = 10.0, 3.0, 6.0
"""A spike is farther from the median than so many times the median bend of the block before, more so many times the
spread of its neighbours; and than so many times that of the bends that are not 0: steps of a converter."""

_LEAST = 10.0 * np.repeat([2e-3, 1e-4], 3)
"""N and N m; a smaller spike does no harm."""


class SpikeFilter:
    """Judges samples in the order of time; the portions in which they come do not matter.

    A contact and a payload last longer than two samples, a clipped channel too, and a vibration spreads the neighbours:
    none of them is a spike. Distances from the median of five are judged, so that a step and a ramp are none, either.
    """

    def __init__(self) -> None:
        self._recent = np.zeros((0, 6))
        self._n_recent_first = 0
        self._known: tuple[int, Array] = -1, np.full(6, np.inf)
        """The number of a block, and what its samples are compared with."""

    @np.errstate(over="ignore")
    def judge(self, wrench: Array, ahead: Array) -> Mask:
        """(N,) samples (N, 6) that are spikes; `ahead` are the samples that follow, two of which count."""
        kept = len(self._recent)
        rows = np.concatenate([self._recent, wrench, ahead[:_SIDE]])
        rows[~np.isfinite(rows)] = np.nan  # no spike, and shows nothing; differences of infinite numbers give warnings
        first = self._n_recent_first
        result = np.zeros(len(wrench), dtype=bool)
        begin, end = max(kept, _SIDE), len(rows) - _SIDE
        if len(wrench) and end > begin:
            block = (first + np.arange(begin, end)) // _BLOCK
            limits = self._limits(rows, int(block[0]), int(block[-1]))[block - block[0]]
            result[begin - kept : end - kept] = _beyond(rows[begin - _SIDE : end + _SIDE], limits)
        past = rows[: kept + len(wrench)]
        keep = min(len(past), 2 * _BLOCK + _SIDE)
        self._recent, self._n_recent_first = past[len(past) - keep :], first + len(past) - keep
        return result

    def _limits(self, rows: Array, low: int, high: int) -> Array:
        """(B, 6) what the samples of the blocks `low` to `high` are compared with: each shows it for the next.

        Nothing is known before the first whole block; that of block `low` is kept from the portion before.
        """
        first = self._n_recent_first
        limits = np.full((high - low + 1, 6), np.inf)
        shown = max(low - 1, -(-(first + _SIDE) // _BLOCK))
        if self._known[0] == low:
            limits[0], shown = self._known[1], max(low, shown)
        if high > shown:
            begin = shown * _BLOCK - first
            around = rows[begin - 1 : begin + (high - shown) * _BLOCK + 1]
            bends = np.abs(around[2:] - 2 * around[1:-1] + around[:-2]) / 2
            limits[shown + 1 - low :] = _usual(bends.reshape(high - shown, _BLOCK, 6))
        self._known = high, limits[-1]
        return limits


def _usual(blocks: Array) -> Array:
    """(B, 6) how far from the median is too far, of the bends of blocks (B, _BLOCK, 6)."""
    moving = np.where(blocks > 0, blocks, np.nan)
    moving[:, 0][np.isnan(moving).all(axis=1)] = np.inf  # a frozen block shows nothing
    middle = np.median(blocks, axis=1)
    if np.isnan(middle).any():
        blocks = blocks.copy()
        blocks[:, 0][np.isnan(blocks).all(axis=1)] = np.inf
        middle = np.nanmedian(blocks, axis=1)
    usual = np.maximum(_USUAL * middle, _QUANTA * np.nanmedian(moving, axis=1))
    return np.asarray(np.maximum(usual, _LEAST))


def _beyond(rows: Array, limits: Array) -> Mask:
    """(M,) for the inner ones of samples (M + 4, 6): farther from the median than their limits (M, 6) allow."""
    near = np.sort(sliding_window_view(rows, 2 * _SIDE + 1, axis=0), axis=2)  # (M, 6, 5)
    apart = np.abs(rows[_SIDE : len(rows) - _SIDE] - near[:, :, _SIDE])
    core = near[:, :, _SIDE + 1] - near[:, :, _SIDE - 1]
    return np.asarray((apart > limits + _CORE * core).any(axis=1))
