"""What a fake sensor feels: a wrench per sample, from an array or a bag, over and over."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from poise.types import Array


class WrenchSource:
    """Wrenches that a fake sensor reports in turn, from the first again after the last.

    Args:
        wrench_in_sensor: (N, 6) or (6,) N and N m, what the load exerts on the sensor.
    """

    def __init__(self, wrench_in_sensor: ArrayLike) -> None:
        self._wrench = np.atleast_2d(np.asarray(wrench_in_sensor, dtype=float))
        if self._wrench.shape[1:] != (6,) or not len(self._wrench):
            raise ValueError(f"a wrench has six numbers a sample, not shape {self._wrench.shape}")

    @classmethod
    def from_bag(cls, path: Path, rate: float) -> "WrenchSource":
        """Replay a bag's wrench, interpolated to `rate` samples a second."""
        from poise.recording import open_recording

        stream = open_recording(path).wrench()
        time = (stream.stamps - stream.stamps[0]) * 1e-9
        grid = np.arange(0.0, time[-1], 1.0 / rate)
        return cls(np.column_stack([np.interp(grid, time, axis) for axis in stream.wrench_in_sensor.T]))

    def samples(self, first: int, count: int) -> Array:
        """Samples number `first` to `first + count - 1`, (count, 6)."""
        return self._wrench[np.arange(first, first + count) % len(self._wrench)]
