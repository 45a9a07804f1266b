"""Samples that come one by one wait here, because checking and summing many at once costs little more than one."""

from typing import Any

import numpy as np

from poise.types import Stamps

_ROOM = 256
_COLUMNS = (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 18))
"""Gravity, linear acceleration, angular velocity, angular acceleration, wrench."""
_THREE, _SIX = (3,), (6,)


class SingleSamples:
    """Up to `_ROOM` samples, copied, in the order in which they came."""

    def __init__(self) -> None:
        self._stamps: Stamps = np.zeros(_ROOM, dtype=np.int64)
        self._rows = np.zeros((_ROOM, 18))
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def take(self, stamp: Any, values: tuple[Any, ...]) -> bool:
        """Copy a sample; False when these are not the arrays of one sample, or when there is no room.

        Args:
            stamp: ns.
            values: gravity, linear acceleration, angular velocity, angular acceleration (3,) and wrench (6,).
        """
        count = self._count
        if count == _ROOM or not isinstance(stamp, np.int64 | int):
            return False
        try:
            gravity, acceleration, omega, alpha, wrench = values
            shapes = gravity.shape == acceleration.shape == omega.shape == alpha.shape == _THREE
            if not shapes or wrench.shape != _SIX:
                return False
            np.concatenate(values, out=self._rows[count])
        except (AttributeError, TypeError):  # lists, or other numbers
            return False
        self._stamps[count] = stamp
        self._count = count + 1
        return True

    def taken(self) -> tuple[Any, ...]:
        """Stamps (N,) and the five values (N, 3) or (N, 6) of all that wait; from now on none does."""
        count, self._count = self._count, 0
        rows = self._rows[:count].copy()  # the checks keep the last wrench
        return (self._stamps[:count].copy(), *(rows[:, columns] for columns in _COLUMNS))
