"""Samples that come one by one wait here, because checking and summing many at once costs little more than one."""

from typing import Any

import numpy as np

_ROOM = 512
_COLUMNS = (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 18))
"""Gravity, linear acceleration, angular velocity, angular acceleration, wrench."""
_THREE, _SIX, _FLOAT = (3,), (6,), np.dtype(np.float64)
_STAMPS = (np.int64, int)


class SingleSamples:
    """Up to `_ROOM` samples, copied, in the order in which they came."""

    def __init__(self) -> None:
        self._stamps: list[Any] = []
        self._rows: list[bytes] = []

    def __len__(self) -> int:
        return len(self._rows)

    def take(self, stamp: Any, values: tuple[Any, ...]) -> bool:
        """Copy a sample; False when these are not the arrays of one sample, or when there is no room.

        Args:
            stamp: ns.
            values: gravity, linear acceleration, angular velocity, angular acceleration (3,) and wrench (6,).
        """
        rows = self._rows
        if len(rows) == _ROOM or not isinstance(stamp, _STAMPS):
            return False
        try:
            gravity, acceleration, omega, alpha, wrench = values
            if not (
                gravity.shape == acceleration.shape == omega.shape == alpha.shape == _THREE
                and wrench.shape == _SIX
                and gravity.dtype is acceleration.dtype is omega.dtype is alpha.dtype is wrench.dtype is _FLOAT
            ):
                return False
            rows.append(b"".join(values))  # the fastest copy of five small arrays
        except (AttributeError, TypeError):  # lists, or arrays with gaps between their numbers
            return False
        self._stamps.append(stamp)
        return True

    def taken(self) -> tuple[Any, ...]:
        """Stamps (N,) and the five values (N, 3) or (N, 6) of all that wait; from now on none does."""
        stamps, rows = np.array(self._stamps, dtype=np.int64), np.frombuffer(b"".join(self._rows)).reshape(-1, 18)
        self._stamps, self._rows = [], []
        return (stamps, *(rows[:, columns] for columns in _COLUMNS))
