"""Which samples were not used, and why, as intervals; and how many for which reason."""

from collections import Counter, deque

import numpy as np

from poise.inertia.model.solution import RejectedInterval
from poise.robot import USED, PairingReasons
from poise.types import Stamps


class RejectionLog:
    """Intervals of consecutive samples that share a reason; only the newest `limit` are kept (None: all)."""

    def __init__(self, limit: int | None) -> None:
        self.counts: Counter[str] = Counter()
        """Samples by reason, of all time."""
        self._intervals: deque[RejectedInterval] = deque(maxlen=limit)
        self._open = False  # the next sample may prolong the last interval

    @property
    def intervals(self) -> tuple[RejectedInterval, ...]:
        """In the order of time."""
        return tuple(self._intervals)

    def add(self, stamps: Stamps, reasons: PairingReasons) -> None:
        """Note what became of samples (N,), in the order of time; an empty reason means used."""
        if not len(stamps):
            return
        changes = np.flatnonzero(reasons[1:] != reasons[:-1]) + 1
        for part in np.split(np.arange(len(stamps)), changes):
            reason = str(reasons[part[0]])
            if reason != USED:
                self._note(int(stamps[part[0]]), int(stamps[part[-1]]), len(part), reason)
            self._open = reason != USED

    def _note(self, start: int, end: int, count: int, reason: str) -> None:
        self.counts[reason] += count
        if self._open and self._intervals and self._intervals[-1].reason == reason:
            last = self._intervals.pop()
            start, count = last.start, last.n_samples + count
        self._intervals.append(RejectedInterval(start, end, count, reason))
