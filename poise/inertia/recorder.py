"""Samples in, one by one or many at once: checked at the door, paired with the motion, and summed into blocks."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.inertia.blocks import BLOCK, Blocks, BlockStore, Stamps
from poise.inertia.delay import LagGrid
from poise.inertia.parameters import Array
from poise.inertia.rejection import RejectionLog
from poise.inertia.signals import N_MOTION, N_SIGNALS, motion_signals

LARGEST_GAP = 100_000_000
"""ns between kinematics, beyond which nobody knows what the robot did."""

CHUNK = 64
"""Samples that wait before they are summed; together they cost little more than one."""

PORTION = 4096
"""Samples that are in memory at all lags at once."""

NOT_FINITE, OUT_OF_ORDER, SATURATED, STALE, NO_KINEMATICS, USED = (
    "not_finite",
    "out_of_order",
    "saturated",
    "stale",
    "no_kinematics",
    "",
)

STALE_AFTER = 4
"""A moving sensor that gives the same six numbers this many times in a row is asleep."""

MOVING = 0.05
"""rad/s."""

MAX_INTERVALS = 1000
"""Of rejected samples that are remembered."""


class BlockRecorder:
    """Checks samples at the door, pairs each wrench with the motion at every lag, and sums them into blocks.

    Blocks are cut by the stamps alone, so it does not matter in which portions samples come.

    Args:
        grid: the lags.
        limits: (6,) |wrench| from which the sensor is saturated, N and N m; infinite when not known.
    """

    def __init__(self, grid: LagGrid, limits: ArrayLike = np.inf) -> None:
        self.grid = grid
        self.log = RejectionLog(MAX_INTERVALS)
        self._limits = np.broadcast_to(np.asarray(limits, dtype=np.float64), 6)
        self._new: list[tuple[Stamps, Array, Array]] = []
        self._n_new = 0
        self._last_stamp = np.iinfo(np.int64).min
        self._last_wrench, self._repeats = np.full(6, np.nan), 0
        # Motion in memory, and wrenches that wait for what comes after them.
        self._stamps, self._motion = np.zeros(0, dtype=np.int64), np.zeros((0, N_MOTION))
        self._waiting = np.zeros(0, dtype=np.int64), np.zeros((0, 6)), np.zeros(0, dtype="<U16")
        self._store = BlockStore(len(grid))

    @property
    def blocks(self) -> Blocks:
        """All of them; the last one may still grow."""
        self._flush()
        return self._store.blocks

    @property
    def newest(self) -> int:
        """Stamp of the newest sample that was let in, ns."""
        return int(self._last_stamp)

    def add(
        self,
        stamps: ArrayLike,
        gravity_minus_acceleration: ArrayLike,
        angular_velocity: ArrayLike,
        angular_acceleration: ArrayLike,
        wrench: ArrayLike,
    ) -> None:
        """Add samples in the order of time: (N,) ns, (N, 3) m/s2, (N, 3) rad/s, (N, 3) rad/s2, (N, 6) N and N m.

        Raises:
            InputError: TYPE_MISMATCH when the shapes do not belong together.
        """
        when = np.asarray(stamps, dtype=np.int64).reshape(-1)
        values = [
            np.asarray(value, dtype=np.float64).reshape(-1, width)
            for value, width in (
                (gravity_minus_acceleration, 3),
                (angular_velocity, 3),
                (angular_acceleration, 3),
                (wrench, 6),
            )
        ]
        if any(len(value) != len(when) for value in values):
            raise InputError(
                ErrorCode.TYPE_MISMATCH,
                f"estimator: {len(when)} stamps came with {[len(value) for value in values]} rows of"
                " g - a, omega, alpha and wrench; give one row per stamp",
            )
        self._new.append((when, motion_signals(*values[:3]), values[3]))
        self._n_new += len(when)
        if self._n_new >= CHUNK:
            self._flush()

    def _flush(self) -> None:
        """Take in what has come, and sum every wrench whose motion is known at all lags."""
        if not self._n_new:
            return
        stamps, motion, wrench = (np.concatenate(column) for column in zip(*self._new, strict=True))
        self._new, self._n_new = [], 0
        for begin in range(0, len(stamps), PORTION):
            portion = slice(begin, begin + PORTION)
            self._take(stamps[portion], motion[portion], wrench[portion])

    def _take(self, stamps: Stamps, motion: Array, wrench: Array) -> None:
        reasons = self._judge(stamps, motion, wrench)
        known = np.isfinite(motion).all(axis=1) & (reasons != OUT_OF_ORDER)
        self._stamps = np.concatenate([self._stamps, stamps[known]])
        self._motion = np.concatenate([self._motion, motion[known]])
        arrived = (stamps, wrench, reasons)
        self._waiting = tuple(np.concatenate(pair) for pair in zip(self._waiting, arrived, strict=True))  # type: ignore[assignment]
        if len(self._stamps):
            self._pair()

    def _judge(self, stamps: Stamps, motion: Array, wrench: Array) -> NDArray[np.str_]:
        """Why each sample cannot be used, as far as it alone can tell."""
        reasons = np.full(len(stamps), USED, dtype="<U16")
        latest = np.maximum.accumulate(np.concatenate([[self._last_stamp], stamps]))
        self._last_stamp = latest[-1]
        reasons[self._asleep(motion, wrench)] = STALE
        reasons[(np.abs(wrench) >= self._limits).any(axis=1)] = SATURATED
        reasons[~(np.isfinite(motion).all(axis=1) & np.isfinite(wrench).all(axis=1))] = NOT_FINITE
        reasons[stamps <= latest[:-1]] = OUT_OF_ORDER
        return reasons

    def _asleep(self, motion: Array, wrench: Array) -> NDArray[np.bool_]:
        """(N,) bool: the sensor moves, and the wrench has been the same for some time."""
        before = np.concatenate([self._last_wrench[None], wrench[:-1]])
        changed = (wrench != before).any(axis=1)
        place = np.arange(1, len(wrench) + 1)
        repeats = place - np.maximum.accumulate(np.where(changed, place, -self._repeats))
        self._last_wrench, self._repeats = wrench[-1], int(repeats[-1])
        speed_squared = motion[:, 6] + motion[:, 9] + motion[:, 11]  # trace of omega omega
        return np.asarray((repeats >= STALE_AFTER - 1) & (speed_squared > MOVING**2))

    def _pair(self) -> None:
        lags = self.grid.nanoseconds
        stamps, wrench, reasons = self._waiting
        # In the order they came, for an out-of-order stamp must not hold up the others.
        ready = int(np.searchsorted(np.maximum.accumulate(stamps), self._stamps[-1] + lags[0], "right"))
        self._waiting = stamps[ready:], wrench[ready:], reasons[ready:]
        stamps, wrench, reasons = stamps[:ready], wrench[:ready], reasons[:ready].copy()
        at = stamps - lags[:, None]
        left = np.clip(np.searchsorted(self._stamps, at, "right") - 1, 0, max(len(self._stamps) - 2, 0))
        right = np.minimum(left + 1, len(self._stamps) - 1)
        span = self._stamps[right] - self._stamps[left]
        fraction = (at - self._stamps[left]) / np.maximum(span, 1)
        # A wrench at a stamp of the kinematics needs no neighbour.
        unknown = (fraction < 0) | (fraction > 1) | ((span > LARGEST_GAP) & (fraction > 0) & (fraction < 1))
        reasons[unknown.any(axis=0) & (reasons == USED)] = NO_KINEMATICS
        self.log.add(stamps, reasons)
        used = reasons == USED
        if used.any():
            left, right, fraction = left[:, used], right[:, used], fraction[:, used, None]
            motion = (1 - fraction) * self._motion[left] + fraction * self._motion[right]
            share = ((1 - fraction) ** 2 + fraction**2)[:, :, 0]
            self._sum(stamps[used], motion, wrench[used], share)
        oldest = int(np.searchsorted(self._stamps, self._stamps[-1] + 2 * lags[0], "right")) - 1
        self._stamps, self._motion = self._stamps[max(oldest, 0) :], self._motion[max(oldest, 0) :]

    def _sum(self, stamps: Stamps, motion: Array, wrench: Array, share: Array) -> None:
        """Sum (N,) samples with their motion (L, N, 13) and shares of noise (L, N) into blocks."""
        number = stamps // BLOCK
        first = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
        which = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(stamps))))
        place = np.arange(len(stamps)) - first[which]
        rows = np.zeros((len(first), len(motion), place.max() + 1, N_SIGNALS))
        rows[which, :, place, :N_MOTION] = motion.swapaxes(0, 1)
        rows[which, :, place, N_MOTION:] = wrench[:, None]
        last = np.append(first[1:], len(stamps)) - 1
        made = Blocks(
            rows.swapaxes(2, 3) @ rows,
            np.add.reduceat(share, first, axis=1).T,
            np.diff(np.append(first, len(stamps))),
            stamps[first],
            stamps[last],
        )
        self._store.append(made)
