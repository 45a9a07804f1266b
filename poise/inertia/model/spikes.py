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

    def judge(self, wrench: Array, ahead: Array) -> Mask:
        """(N,) samples (N, 6) that are spikes; `ahead` are the samples that follow, two of which count."""
        kept = len(self._recent)
        rows = np.concatenate([self._recent, wrench, ahead[:_SIDE]])
        first = self._n_recent_first
        result = np.zeros(len(rows), dtype=bool)
        if len(wrench) and len(rows) > 2 * _SIDE:
            result[_SIDE : len(rows) - _SIDE] = _spikes(rows, first + _SIDE)
        past = rows[: kept + len(wrench)]
        keep = min(len(past), 2 * _BLOCK + _SIDE)
        self._recent, self._n_recent_first = past[len(past) - keep :], first + len(past) - keep
        return result[kept : kept + len(wrench)]


def _spikes(rows: Array, number: int) -> Mask:
    """(M,) for the inner ones of samples (M + 4, 6), the first of which has this number since the beginning."""
    near = np.sort(sliding_window_view(rows, 2 * _SIDE + 1, axis=0), axis=2)  # (M, 6, 5)
    apart = np.abs(rows[_SIDE : len(rows) - _SIDE] - near[:, :, _SIDE])
    core = near[:, :, _SIDE + 1] - near[:, :, _SIDE - 1]
    begin = -number % _BLOCK
    count = (len(apart) - begin) // _BLOCK
    if count < 1:
        return np.zeros(len(apart), dtype=bool)
    bends = np.abs(rows[2:] - 2 * rows[1:-1] + rows[:-2])[1:-1] / 2
    blocks = bends[begin : begin + count * _BLOCK].reshape(count, _BLOCK, 6)
    moving = np.where(blocks > 0, blocks, np.nan)
    moving[:, 0][np.isnan(moving).all(axis=1)] = np.inf  # a frozen block shows nothing
    usual = np.maximum(_USUAL * np.median(blocks, axis=1), _QUANTA * np.nanmedian(moving, axis=1))
    limits = np.vstack([np.full((1, 6), np.inf), np.maximum(usual, _LEAST)])  # nothing is known before the first block
    before = np.clip((np.arange(len(apart)) - begin) // _BLOCK, 0, count)
    return np.asarray((apart > limits[before] + _CORE * core).any(axis=1))
