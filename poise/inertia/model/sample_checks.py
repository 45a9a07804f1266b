"""The checks that every wrench sample passes once: order in time, numbers, range of the sensor, repeated values."""

import numpy as np
from numpy.typing import ArrayLike

from poise.robot import STALE, USED, PairingReasons
from poise.types import Array, Mask, Stamps

NOT_FINITE, OUT_OF_ORDER, SATURATED = "not_finite", "out_of_order", "saturated"
"""PairingReasons of rejection, as in poise_msgs/RejectedInterval."""

_REPEATS = 4
"""A moving sensor that gives the same six numbers this many times in a row does not measure."""
_MOVING = 0.05
"""rad/s from which on a sensor counts as moving."""


class SampleChecks:
    """Judges samples in the order in which they are used; the portions in which they come do not matter.

    Args:
        limits: (6,) |wrench| at which a channel is saturated, N and N m; infinite when the range is not known.
    """

    def __init__(self, limits: ArrayLike = np.inf) -> None:
        self._limits = np.broadcast_to(np.asarray(limits, dtype=np.float64), 6)
        self.restart()

    def restart(self) -> None:
        """Forget the newest stamp, because the clock has jumped."""
        self._last_stamp = np.iinfo(np.int64).min
        self._last_wrench, self._repeats = np.full(6, np.nan), 0

    def judge(self, stamps: Stamps, wrench: Array, angular_velocity: Array, reasons: PairingReasons) -> PairingReasons:
        """(N,) the reason why each sample cannot be used, empty where it can.

        Args:
            stamps: (N,) ns.
            wrench: (N, 6) N and N m.
            angular_velocity: (N, 3) rad/s of the sensor; NaN where it is not known.
            reasons: (N,) what is wrong with the motion at these stamps.
        """
        if not len(stamps):
            return reasons
        result = reasons.astype("<U16")
        latest = np.maximum.accumulate(np.concatenate([[self._last_stamp], stamps]))
        self._last_stamp = latest[-1]
        with np.errstate(invalid="ignore"):
            moving = np.linalg.norm(angular_velocity, axis=1) > _MOVING
            saturated = np.any(np.abs(wrench) >= self._limits, axis=1)
        result[(result == USED) & moving & self._repeated(wrench)] = STALE
        result[saturated] = SATURATED
        result[~np.isfinite(wrench).all(axis=1)] = NOT_FINITE
        result[(stamps <= latest[:-1]) & (reasons != STALE)] = OUT_OF_ORDER
        return result

    def _repeated(self, wrench: Array) -> Mask:
        """(N,) the wrench has had the same six numbers for `_REPEATS` samples."""
        before = np.concatenate([self._last_wrench[None], wrench[:-1]])
        changed = (wrench != before).any(axis=1)
        place = np.arange(1, len(wrench) + 1)
        repeats = place - np.maximum.accumulate(np.where(changed, place, -self._repeats))
        self._last_wrench, self._repeats = wrench[-1], int(repeats[-1])
        return np.asarray(repeats >= _REPEATS - 1)
