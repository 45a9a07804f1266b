"""Which samples of a numbered stream are new, late, duplicate or lost."""

import numpy as np
from numpy.typing import NDArray

REORDER_WINDOW = 4096
"""How far back, in samples, a late sample is distinguished from a duplicate."""
MAX_GAP = 1 << 24
"""A longer step forward (40 min at 7 kHz) is a restart of the device."""


class SequenceCounter:
    """Accounts for every number of a 32-bit wrapping sequence.

    As long as the device does not restart, received + lost is what it has sent since the first sample that arrived,
    up to the newest one.

    Attributes:
        received: different samples that arrived, late ones included.
        lost: numbers that were skipped and have not come since.
        out_of_order: samples that came after a later one (a part of `received`).
        duplicates: copies of samples that had come already (no part of `received`).
        restarts: how often the numbers restarted.
    """

    def __init__(self) -> None:
        self.received = 0
        self.lost = 0
        self.out_of_order = 0
        self.duplicates = 0
        self.restarts = 0
        self._last: int | None = None
        self._position = -1
        self._missing: set[int] = set()
        self._restart_expected = False

    def expect_restart(self) -> None:
        """The device was asked to start its stream: the next number that is not larger than the last is a restart."""
        self._restart_expected = True

    def account(self, sequence: NDArray[np.uint32]) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
        """Account for one read.

        Args:
            sequence: (N,) numbers in order of arrival.

        Returns:
            index: (M,) which of them to use, in the order of measurement: new, and none older than what earlier
                calls returned (a later one is counted, but cannot be inserted into a running stream).
            position: (M,) their places in a count that neither wraps nor restarts; gaps are kept.
        """
        count = len(sequence)
        if count and self._last is not None:
            expected = np.arange(self._last + 1, self._last + 1 + count).astype(np.uint32)
            if np.array_equal(sequence, expected):
                first = self._position + 1
                self._position += count
                self._last = int(sequence[-1])
                self.received += count
                return np.arange(count), np.arange(first, first + count)
        return self._account_one_by_one(sequence)

    def _account_one_by_one(self, sequence: NDArray[np.uint32]) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
        before = self._position
        news: list[tuple[int, int]] = []
        for index, number in enumerate(sequence.tolist()):
            position = self._place(number)
            if position > before:
                news.append((position, index))
        news.sort()
        self._missing = {place for place in self._missing if place > self._position - REORDER_WINDOW}
        return (
            np.array([index for _, index in news], dtype=np.intp),
            np.array([position for position, _ in news], dtype=np.int64),
        )

    def _place(self, number: int) -> int:
        """Count one number; return its position, or -1 when it is a duplicate."""
        if self._last is None:
            step = 1
            self._restart_expected = False
        else:
            step = (number - self._last + (1 << 31)) % (1 << 32) - (1 << 31)  # signed distance round the wrap
            if step > MAX_GAP or step <= -REORDER_WINDOW or (step <= 0 and self._restart_expected):
                self.restarts += 1
                self._restart_expected = False
                self._missing.clear()
                step = 1
        position = self._position + step
        if step > 0:
            self.lost += step - 1
            self._missing.update(range(max(self._position + 1, position - REORDER_WINDOW), position))
            self._position = position
            self._last = number
        elif position in self._missing:
            self._missing.remove(position)
            self.lost -= 1
            self.out_of_order += 1
        else:
            self.duplicates += 1
            return -1
        self.received += 1
        return position
