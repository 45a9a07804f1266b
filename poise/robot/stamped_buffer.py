"""Stamped rows in the order of time, of which the oldest can be forgotten."""

import numpy as np
from numpy.typing import ArrayLike

from poise.types import Array, Stamps

CLOCK_JUMP = 500_000_000
"""ns; stamps that go back by more are not late messages: the clock was set, or a recording started over."""


def went_back(stamps: Stamps, newest: int | None) -> bool:
    """New stamps (N,) lie so far before the newest one known that the clock must have been set back."""
    return newest is not None and bool(len(stamps)) and int(stamps[0]) < newest - CLOCK_JUMP


class StampedBuffer:
    """Rows of `width` numbers with int64 ns stamps; adding is cheap, late ones are put in their place."""

    def __init__(self, width: int) -> None:
        self._stamps: Stamps = np.zeros(0, dtype=np.int64)
        self._rows: Array = np.zeros((0, width))
        self._new: list[tuple[Stamps, Array]] = []
        self.newest: int | None = None
        """The last stamp."""

    def extend(self, stamps: Stamps, rows: ArrayLike) -> None:
        """Add (N,) stamps with their rows (N, width)."""
        times = np.asarray(stamps, dtype=np.int64)
        if len(times):
            self._new.append((times, np.asarray(rows, dtype=np.float64)))
            latest = int(times.max())
            self.newest = latest if self.newest is None else max(self.newest, latest)

    @property
    def stamps(self) -> Stamps:
        """(N,) ns, not falling."""
        self._settle()
        return self._stamps

    @property
    def rows(self) -> Array:
        """(N, width)."""
        self._settle()
        return self._rows

    def between(self, begin: int, end: int) -> tuple[Stamps, Array]:
        """Stamps and rows with begin <= stamp <= end."""
        low, high = np.searchsorted(self.stamps, begin, "left"), np.searchsorted(self.stamps, end, "right")
        return self._stamps[low:high], self._rows[low:high]

    def forget_before(self, stamp: int) -> None:
        """Drop everything older than a stamp."""
        keep = int(np.searchsorted(self.stamps, stamp, "left"))
        self._stamps, self._rows = self._stamps[keep:].copy(), self._rows[keep:].copy()

    def clear(self) -> None:
        """Drop everything."""
        self._stamps, self._rows, self._new, self.newest = self._stamps[:0], self._rows[:0], [], None

    def _settle(self) -> None:
        if not self._new:
            return
        self._stamps = np.concatenate([self._stamps, *(stamps for stamps, _ in self._new)])
        self._rows = np.concatenate([self._rows, *(rows for _, rows in self._new)])
        self._new = []
        if np.any(self._stamps[1:] < self._stamps[:-1]):
            order = np.argsort(self._stamps, kind="stable")
            self._stamps, self._rows = self._stamps[order], self._rows[order]
