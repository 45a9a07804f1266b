"""From thousands of samples a second to a publishing rate: block averages, stamped at the centre of the block.

The mean over a block is a filter of linear phase: every frequency is delayed by half the block, and stamping the
centre takes that delay out. Its first zero is at the publishing rate; there is no overshoot.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.types import Array, Mask


@dataclass(frozen=True)
class Stamped:
    """SensorSamples with their times.

    Attributes:
        position: (N,) int64 place in an endless count; gaps are lost samples.
        stamps: (N,) int64 ns when they were measured.
        wrench_in_sensor: (N, 6) N and N m.
        saturated, faulty: (N,) bool.
    """

    position: NDArray[np.int64]
    stamps: NDArray[np.int64]
    wrench_in_sensor: Array
    saturated: Mask
    faulty: Mask

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, part: slice) -> "Stamped":
        return Stamped(
            self.position[part],
            self.stamps[part],
            self.wrench_in_sensor[part],
            self.saturated[part],
            self.faulty[part],
        )

    def __add__(self, other: "Stamped") -> "Stamped":
        return Stamped(
            np.concatenate([self.position, other.position]),
            np.concatenate([self.stamps, other.stamps]),
            np.concatenate([self.wrench_in_sensor, other.wrench_in_sensor]),
            np.concatenate([self.saturated, other.saturated]),
            np.concatenate([self.faulty, other.faulty]),
        )


@dataclass(frozen=True)
class BlockAverages:
    """Block averages.

    Attributes:
        stamps: (B,) int64 ns, the mean time of the samples in the block.
        wrench_in_sensor: (B, 6) mean, N and N m.
        count: (B,) how many samples the mean is of; fewer than the block's size where samples were lost.
        saturated, faulty: (B,) bool, true when any sample of the block is.
    """

    stamps: NDArray[np.int64]
    wrench_in_sensor: Array
    count: NDArray[np.int64]
    saturated: Mask
    faulty: Mask

    def __len__(self) -> int:
        return len(self.stamps)

    def take(self, which: Mask) -> "BlockAverages":
        """The blocks marked, (B,) bool."""
        return BlockAverages(
            self.stamps[which],
            self.wrench_in_sensor[which],
            self.count[which],
            self.saturated[which],
            self.faulty[which],
        )


class BlockAverager:
    """Averages blocks of `size` consecutive sequence numbers.

    BlockAverages are cut by number, not by count, so a lost sample thins its own block and shifts no other.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._pending: Stamped | None = None

    def push(self, samples: Stamped) -> BlockAverages:
        """Take samples in order of position; return the blocks that they complete."""
        if self._pending is not None:
            samples = self._pending + samples
        block = samples.position // self.size
        complete = len(samples)
        if complete and (samples.position[-1] + 1) % self.size:  # the last block waits for its end
            complete = int(np.searchsorted(block, block[-1]))
        self._pending = samples[complete:] if complete < len(samples) else None
        return _average(samples[:complete], block[:complete])

    def clear(self) -> None:
        """Drop an unfinished block."""
        self._pending = None


def _average(samples: Stamped, block: NDArray[np.int64]) -> BlockAverages:
    if not len(samples):
        none = np.empty(0, dtype=np.int64)
        return BlockAverages(none, np.empty((0, 6)), none, none.astype(bool), none.astype(bool))
    start = np.flatnonzero(np.diff(block, prepend=block[0] - 1))
    count = np.diff(start, append=len(block))
    first = samples.stamps[start]
    since = samples.stamps - np.repeat(first, count)
    return BlockAverages(
        first + np.add.reduceat(since, start) // count,
        np.add.reduceat(samples.wrench_in_sensor, start) / count[:, None],
        count,
        np.logical_or.reduceat(samples.saturated, start),
        np.logical_or.reduceat(samples.faulty, start),
    )


def block_size(sample_rate: float, publish_rate: float) -> int:
    """How many samples make a block so that blocks come at about `publish_rate`, never faster than asked."""
    return max(1, int(np.ceil(sample_rate / publish_rate - 1e-6)))
