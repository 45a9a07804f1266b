"""Sums over samples, kept apart in blocks of a tenth of a second, so that a bad tenth can be left out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.inertia.parameters import Array
from poise.inertia.signals import N_SIGNALS

Stamps = NDArray[np.int64]

BLOCK = 100_000_000
"""ns: a push lasts longer, and a clean tenth of a second beside it is worth keeping."""

MAX_BLOCKS = 600
"""A minute of them; from then on they are merged two by two."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """B blocks in the order of time, L lags.

    Args:
        moments: (B, L, 19, 19) sums of s s^T, the motion taken a lag before the wrench; see `signals`.
        counts: (B, L) samples, less what interpolation has averaged out of the noise of accelerations.
        sizes: (B,) samples.
        start, end: (B,) stamps of the first and the last wrench, ns.
    """

    moments: Array
    counts: Array
    sizes: Stamps
    start: Stamps
    end: Stamps

    def __len__(self) -> int:
        return len(self.sizes)

    @classmethod
    def empty(cls, capacity: int, n_lags: int) -> "Blocks":
        """Room for some."""
        return cls(
            np.zeros((capacity, n_lags, N_SIGNALS, N_SIGNALS)),
            np.zeros((capacity, n_lags)),
            *(np.zeros(capacity, dtype=np.int64) for _ in range(3)),
        )

    def select(self, which: "NDArray[np.bool_] | slice") -> "Blocks":
        """Some of them."""
        return Blocks(self.moments[which], self.counts[which], self.sizes[which], self.start[which], self.end[which])

    def merged(self, length: int) -> "Blocks":
        """Sums over the blocks that begin in the same `length` ns."""
        number = self.start // length
        first = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
        last = np.append(first[1:], len(self)) - 1
        return Blocks(
            np.add.reduceat(self.moments, first, axis=0),
            np.add.reduceat(self.counts, first, axis=0),
            np.add.reduceat(self.sizes, first),
            self.start[first],
            self.end[last],
        )


_FIELDS = ("moments", "counts", "sizes", "start", "end")


class BlockStore:
    """Blocks that become more, up to `MAX_BLOCKS`; then they become longer. What they sum up to is never lost."""

    def __init__(self, n_lags: int) -> None:
        self._room = Blocks.empty(32, n_lags)
        self._n = 0
        self.length = BLOCK
        self._marked: tuple[int, Blocks] | None = None

    @property
    def blocks(self) -> Blocks:
        """All of them, as views."""
        return self._room.select(slice(0, self._n))

    def mark(self) -> None:
        """Remember how it is now."""
        last = self._room.select(slice(max(self._n - 1, 0), self._n))
        self._marked = self._n, Blocks(*(getattr(last, name).copy() for name in _FIELDS))

    def rewind(self) -> None:
        """Forget what came after the mark, if there is one."""
        if self._marked is not None:
            self._n, last = self._marked
            _copy(last, self._room, max(self._n - 1, 0))
            self._marked = None

    def append(self, new: Blocks) -> None:
        """Add blocks of `BLOCK`, the first of which may go on with the last one there is."""
        if self.length != BLOCK:
            new = new.merged(self.length)
        joins = self._n > 0 and self._room.start[self._n - 1] // self.length == new.start[0] // self.length
        begin = self._n - int(joins)
        if joins:
            for name in ("moments", "counts", "sizes"):
                getattr(new, name)[0] += getattr(self._room, name)[begin]
            new.start[0] = self._room.start[begin]
        if begin + len(new) > len(self._room):
            grown = Blocks.empty(2 * (begin + len(new)), self._room.moments.shape[1])
            _copy(self.blocks, grown, 0)
            self._room = grown
        _copy(new, self._room, begin)
        self._n = begin + len(new)
        while self._n > MAX_BLOCKS and self._marked is None:
            self.length *= 2
            merged = self.blocks.merged(self.length)
            _copy(merged, self._room, 0)
            self._n = len(merged)


def _copy(source: Blocks, target: Blocks, begin: int) -> None:
    for name in _FIELDS:
        getattr(target, name)[begin : begin + len(source)] = getattr(source, name)
