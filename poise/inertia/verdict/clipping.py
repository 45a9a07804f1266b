"""Readings that stop at one value: a sensor or driver that clips."""

import numpy as np

from poise.types import Array

_LEAST_HITS, _LEAST_SHARE = 10, 0.003
"""Readings of exactly the extreme value of a channel, and their share, from which on it clips."""

_COARSE = 0.2
"""Share of consecutive equal readings from which on a channel is quantised too coarsely to judge."""

_BETWEEN = 0.1
"""Least share of readings that are not at an end."""


class ExtremeReadings:
    """Counts how often each channel reads exactly its extreme value; the portions do not matter."""

    def __init__(self) -> None:
        self._n = 0
        self._equal = np.zeros(6)
        # The upper ends of the channels and of their negatives.
        self._most = np.full(12, -np.inf)
        self._hits, self._runs = np.zeros(12), np.zeros(12)
        self._last = np.full((1, 6), np.nan)

    def add(self, wrench: Array) -> None:
        """Take wrenches (N, 6) in the order of time."""
        rows = np.concatenate([self._last, wrench])
        equal = rows[1:] == rows[:-1]
        both = np.concatenate([wrench, -wrench], axis=1)
        most = both.max(axis=0)
        for counts in (self._hits, self._runs):
            counts[most > self._most] = 0.0
        self._most = np.maximum(self._most, most)
        at_end = both == self._most
        self._hits += at_end.sum(axis=0)
        self._runs += (at_end & np.tile(equal, 2)).sum(axis=0)
        self._equal += equal.sum(axis=0)
        self._n += len(wrench)
        self._last = rows[-1:]

    @property
    def clipped(self) -> tuple[int, float, float] | None:
        """Channel, value and share of the readings of the worst clipped channel; None: no channel clips."""
        if not self._n:
            return None
        ends = self._hits[:6] + self._hits[6:]
        between = self._n - ends
        repeats = (self._equal - self._runs[:6] - self._runs[6:]) / between.clip(min=1)
        fine = (between > _BETWEEN * self._n) & (repeats < _COARSE)
        clips = (self._hits >= max(_LEAST_HITS, _LEAST_SHARE * self._n)) & np.tile(fine, 2) & (self._runs > 0)
        if not clips.any():
            return None
        worst = int(np.argmax(np.where(clips, self._hits, 0.0)))
        value = self._most[worst] if worst < 6 else -self._most[worst]
        return worst % 6, float(value), float(self._hits[worst] / self._n)
