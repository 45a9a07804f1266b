"""The white noise of a stream, from the second differences of its samples."""

import numpy as np
from scipy.special import ndtri

from poise.types import Array

_QUIET = 25
"""Percentile over blocks that counts: other blocks may hold shaking, which is no noise."""

_BLOCK = 40
"""Samples."""

_ALIKE = 1.92
"""By how much more a mean over a block varies than of as many independent squares: those of neighbouring second
differences have the correlations 16/36 and 1/36."""

_MOST_BLOCKS = 4096
"""Blocks that are remembered; of more, every second one is kept, then every fourth and so on."""


class ScatterMeter:
    """White noise of samples that come one by one or in portions.

    A smooth signal hardly has second differences; white noise of variance s^2 has them with variance 6 s^2.
    """

    def __init__(self) -> None:
        self._new: list[Array] = []
        self._squares: list[float] = []
        self._n_blocks, self._stride, self._n_new, self._n_columns = 0, 1, 0, 1
        self._value: tuple[int, float] = 0, np.nan
        """Of how many blocks, and one sigma."""

    def add(self, values: Array) -> None:
        """Take samples (N, K) in the order of time."""
        if len(values):
            self._new.append(values)
            self._n_new += len(values)
        if len(self._new) > _BLOCK:
            self._settle()

    @property
    def value(self) -> float:
        """One sigma of a sample; NaN for too few."""
        if self._value[0] != self.n_blocks:
            quiet = float(np.percentile(self._squares, _QUIET)) / self._quiet_share if self._squares else np.nan
            self._value = self._n_blocks, float(np.sqrt(quiet / 6))
        return self._value[1]

    @property
    def _quiet_share(self) -> float:
        """What the percentile of white noise is in units of its mean: blocks vary by chance (Wilson and Hilferty)."""
        count = len(self._squares)
        place = (0.01 * _QUIET * (count - 1) + 0.625) / (count + 0.25)  # of an order statistic (Blom 1958)
        spread = 2 * _ALIKE / (9 * _BLOCK * self._n_columns)
        return float((1 - spread + ndtri(place) * np.sqrt(spread)) ** 3)

    @property
    def n_blocks(self) -> int:
        """How many blocks of samples have been seen: `value` changes with it."""
        self._settle()
        return self._n_blocks

    def _settle(self) -> None:
        if self._n_new < _BLOCK + 2:
            return
        values = np.concatenate(self._new)
        self._n_columns = values.shape[1]
        bends = np.diff(values, n=2, axis=0)
        count = len(bends) // _BLOCK
        self._new = [values[count * _BLOCK :]]
        self._n_new = len(self._new[0])
        for square in np.mean(bends[: count * _BLOCK].reshape(count, -1) ** 2, axis=1).tolist() if count else []:
            if self._n_blocks % self._stride == 0:
                self._squares.append(square)
            self._n_blocks += 1
            if len(self._squares) > _MOST_BLOCKS:
                self._squares, self._stride = self._squares[::2], 2 * self._stride


def scatter(values: Array) -> float:
    """One sigma of the white noise in samples (N, K) in a row; NaN for too few."""
    meter = ScatterMeter()
    meter.add(values)
    return meter.value
