"""Sums over samples, kept apart in blocks of a tenth of a second, so that a bad tenth can be left out."""

from dataclasses import dataclass

import numpy as np

from poise.inertia.model import N_MOTION, N_SIGNALS
from poise.types import Array, Mask, Stamps

BLOCK = 100_000_000
"""ns: a push lasts longer, and a clean tenth of a second beside it is worth keeping."""

_MAX_BLOCKS = 600
"""A minute of them; from then on the older half is merged two by two, again and again."""


@dataclass(frozen=True, eq=False)
class MomentBlocks:
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
    def empty(cls, capacity: int, n_lags: int) -> "MomentBlocks":
        """Room for some."""
        return cls(
            np.zeros((capacity, n_lags, N_SIGNALS, N_SIGNALS)),
            np.zeros((capacity, n_lags)),
            *(np.zeros(capacity, dtype=np.int64) for _ in range(3)),
        )

    def select(self, which: "Mask | slice") -> "MomentBlocks":
        """Some of them."""
        return MomentBlocks(
            self.moments[which], self.counts[which], self.sizes[which], self.start[which], self.end[which]
        )

    def averaged(self) -> "MomentBlocks":
        """The same with the average motion of each block only; wrenches keep their scatter.

        An accelerometer on a shaking arm errs by more than the attitude changes in the first second. In a regression,
        such errors make the payload too light (errors in variables); averages over blocks hardly contain them.
        """
        sums = self.moments[:, :, N_MOTION - 1]
        moments = sums[..., :, None] * sums[..., None, :] / self.sizes[:, None, None, None]
        moments[..., N_MOTION:, N_MOTION:] = self.moments[..., N_MOTION:, N_MOTION:]
        return MomentBlocks(moments, self.counts / self.sizes[:, None], self.sizes, self.start, self.end)

    def mixed(self, weights: Array) -> Array:
        """(B, 19, 19) sums for one delay, by the weights (L,) of the lags."""
        rows = self.moments.reshape(*self.moments.shape[:2], -1)
        return np.asarray((weights @ rows).reshape(-1, *self.moments.shape[2:]))

    def in_pairs(self) -> "MomentBlocks":
        """Every two neighbours as one; there has to be an even number."""
        return MomentBlocks(
            self.moments[::2] + self.moments[1::2],
            self.counts[::2] + self.counts[1::2],
            self.sizes[::2] + self.sizes[1::2],
            self.start[::2],
            self.end[1::2],
        )


_FIELDS = ("moments", "counts", "sizes", "start", "end")


class BlockStore:
    """MomentBlocks that become more, up to `_MAX_BLOCKS`; then the older ones become longer. No sum is ever lost.

    Args:
        n_lags: at which samples are paired.
        length: ns of a block.
    """

    def __init__(self, n_lags: int, length: int = BLOCK) -> None:
        self._length = length
        self._room = MomentBlocks.empty(32, n_lags)
        self._n = 0
        self._marked: tuple[int, MomentBlocks] | None = None

    @property
    def blocks(self) -> MomentBlocks:
        """All of them, as views."""
        return self._room.select(slice(0, self._n))

    def mark(self) -> None:
        """Remember how it is now."""
        last = self._room.select(slice(max(self._n - 1, 0), self._n))
        self._marked = self._n, MomentBlocks(*(getattr(last, name).copy() for name in _FIELDS))

    def rewind(self) -> None:
        """Forget what came after the mark, if there is one."""
        if self._marked is not None:
            self._n, last = self._marked
            _copy(last, self._room, max(self._n - 1, 0))
            self._marked = None

    def append(self, new: MomentBlocks) -> None:
        """Add blocks of the agreed length, the first of which may go on with the last one there is."""
        if self._n and self._room.start[self._n - 1] // self._length == new.start[0] // self._length:
            for name in ("moments", "counts", "sizes"):
                getattr(self._room, name)[self._n - 1] += getattr(new, name)[0]
            self._room.end[self._n - 1] = new.end[0]
            new = new.select(slice(1, None))
        while len(new):
            # Whatever comes at once, blocks are merged when they would be if they came one by one.
            space = _MAX_BLOCKS - self._n if self._marked is None else len(new)
            self._extend(new.select(slice(0, space)))
            new = new.select(slice(space, None))
            if len(new):
                half = self._room.select(slice(0, _MAX_BLOCKS // 2)).in_pairs()
                rest = self._room.select(slice(_MAX_BLOCKS // 2, self._n))
                rest = MomentBlocks(*(getattr(rest, name).copy() for name in _FIELDS))
                _copy(half, self._room, 0)
                _copy(rest, self._room, len(half))
                self._n = len(half) + len(rest)

    def _extend(self, new: MomentBlocks) -> None:
        if self._n + len(new) > len(self._room):
            grown = MomentBlocks.empty(2 * (self._n + len(new)), self._room.moments.shape[1])
            _copy(self.blocks, grown, 0)
            self._room = grown
        _copy(new, self._room, self._n)
        self._n += len(new)


def _copy(source: MomentBlocks, target: MomentBlocks, begin: int) -> None:
    for name in _FIELDS:
        getattr(target, name)[begin : begin + len(source)] = getattr(source, name)
