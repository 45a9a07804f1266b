"""Samples in, one by one or many at once: checked at the door, paired with the motion, and summed into blocks."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.inertia.bayes.blocks import BLOCK, BlockStore, MomentBlocks
from poise.inertia.bayes.delay import LagGrid
from poise.inertia.model import N_MOTION, N_SIGNALS, RejectionLog, motion_signals
from poise.types import Array, Mask, Stamps

LARGEST_GAP = 100_000_000
"""ns between kinematics across which nothing is interpolated."""

CHUNK = 64
"""Samples that wait before they are summed; together they cost little more than one."""

PORTION = 4096
"""Samples that are in memory at all lags at once."""

NOT_FINITE, OUT_OF_ORDER, SATURATED, STALE, USED = "not_finite", "out_of_order", "saturated", "stale", ""

STALE_AFTER = 4
"""A moving sensor that gives the same six numbers this many times in a row is asleep."""

MOVING = 0.05
"""rad/s."""

MAX_INTERVALS = 1000
"""Of rejected samples that are remembered."""

SPECIFIC, OMEGA, ALPHA, WRENCH = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 15)
"""Columns of a sample: g - a, omega, alpha, wrench."""


class BlockRecorder:
    """Checks samples at the door, pairs each wrench with the motion at every lag, and sums them into blocks.

    Blocks are cut by the stamps alone, and what a sample is worth does not depend on how it came, so it does not matter
    in which portions samples come.

    Args:
        grid: the lags.
        limits: (6,) |wrench| from which the sensor is saturated, N and N m; infinite when not known.
        block: ns of a block.
    """

    def __init__(self, grid: LagGrid, limits: ArrayLike = np.inf, block: int = BLOCK) -> None:
        self.grid = grid
        self._block = block
        self.log = RejectionLog(MAX_INTERVALS)
        self._limits = np.broadcast_to(np.asarray(limits, dtype=np.float64), 6)
        self._new: list[tuple[Stamps, list[Array]]] = []
        self._n_new = 0
        self._last_stamp = np.iinfo(np.int64).min
        self._last_wrench, self._repeats = np.full(6, np.nan), 0
        # Samples in memory, as neighbours of others, and how many of the newest have not been summed for good.
        self._stamps, self._rows = np.zeros(0, dtype=np.int64), np.zeros((0, 15))
        self._usable = np.zeros(0, dtype=bool)
        self._n_waiting = 0
        self._store = BlockStore(len(grid), block)

    @property
    def blocks(self) -> MomentBlocks:
        """All of them; the last ones may still grow, and what will come next is guessed for the newest samples."""
        self._flush()
        self._store.rewind()
        self._store.mark()
        self._pair(self._n_waiting)
        return self._store.blocks

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
        given = (gravity_minus_acceleration, angular_velocity, angular_acceleration, wrench)
        columns = [np.asarray(value, dtype=np.float64).reshape(-1, 6 if value is wrench else 3) for value in given]
        if any(len(column) != len(when) for column in columns):
            raise InputError(
                ErrorCode.TYPE_MISMATCH,
                f"estimator: {len(when)} stamps came with {[len(column) for column in columns]} rows of"
                " g - a, omega, alpha and wrench; give one row per stamp",
            )
        self._new.append((when, columns))
        self._n_new += len(when)
        if self._n_new >= CHUNK:
            self._flush()

    def _flush(self) -> None:
        """Take in what has come, and sum the wrenches around which the motion is known by now."""
        if not self._n_new:
            return
        self._store.rewind()
        stamps = np.concatenate([when for when, _ in self._new])
        rows = np.concatenate([np.concatenate(columns, axis=1) for _, columns in self._new])
        self._new, self._n_new = [], 0
        for begin in range(0, len(stamps), PORTION):
            self._take(stamps[begin : begin + PORTION], rows[begin : begin + PORTION])

    def _take(self, stamps: Stamps, rows: Array) -> None:
        reasons = self._judge(stamps, rows)
        self.log.add(stamps, reasons)
        known = np.isfinite(rows[:, :9]).all(axis=1) & (reasons != OUT_OF_ORDER)
        self._stamps = np.concatenate([self._stamps, stamps[known]])
        self._rows = np.concatenate([self._rows, rows[known]])
        self._usable = np.concatenate([self._usable, reasons[known] == USED])
        self._n_waiting += int(known.sum())
        if not self._n_waiting:
            return
        waiting = self._stamps[-self._n_waiting :]
        ready = int(np.searchsorted(waiting, self._stamps[-1] + self.grid.nanoseconds[0], "right"))
        self._pair(ready)
        self._n_waiting -= ready
        # Neighbours on both sides of the longest lag are remembered.
        oldest = max(len(self._stamps) - self._n_waiting, 1) - 1
        begin = int(np.searchsorted(self._stamps, self._stamps[oldest] + self.grid.nanoseconds[0], "left")) - 1
        begin = max(begin, 0)
        self._stamps, self._rows = self._stamps[begin:], self._rows[begin:]
        self._usable = self._usable[begin:]

    def _judge(self, stamps: Stamps, rows: Array) -> NDArray[np.str_]:
        """Why each sample cannot be used, empty where it can."""
        reasons = np.full(len(stamps), USED, dtype="<U16")
        latest = np.maximum.accumulate(np.concatenate([[self._last_stamp], stamps]))
        self._last_stamp = latest[-1]
        reasons[self._asleep(rows)] = STALE
        reasons[(np.abs(rows[:, WRENCH]) >= self._limits).any(axis=1)] = SATURATED
        reasons[~np.isfinite(rows).all(axis=1)] = NOT_FINITE
        reasons[stamps <= latest[:-1]] = OUT_OF_ORDER
        return reasons

    def _asleep(self, rows: Array) -> Mask:
        """(N,) bool: the sensor moves, and the wrench has been the same for some time."""
        wrench = rows[:, WRENCH]
        before = np.concatenate([self._last_wrench[None], wrench[:-1]])
        changed = (wrench != before).any(axis=1)
        place = np.arange(1, len(wrench) + 1)
        repeats = place - np.maximum.accumulate(np.where(changed, place, -self._repeats))
        self._last_wrench, self._repeats = wrench[-1], int(repeats[-1])
        moving = np.linalg.norm(rows[:, OMEGA], axis=1) > MOVING
        return np.asarray((repeats >= STALE_AFTER - 1) & moving)

    def _pair(self, count: int) -> None:
        """Sum the first `count` of the waiting samples, each with the motion at every lag before its stamp."""
        begin = len(self._stamps) - self._n_waiting
        which = begin + np.flatnonzero(self._usable[begin : begin + count])
        if not len(which):
            return
        stamps, own = self._stamps[which], self._rows[which]
        at = stamps - self.grid.nanoseconds[:, None]
        left = np.clip(np.searchsorted(self._stamps, at, "right") - 1, 0, max(len(self._stamps) - 2, 0))
        right = np.minimum(left + 1, len(self._stamps) - 1)
        span = self._stamps[right] - self._stamps[left]
        fraction = ((at - self._stamps[left]) / np.maximum(span, 1))[..., None]
        motion = (1 - fraction) * self._rows[left, :9] + fraction * self._rows[right, :9]
        beside = ((fraction[..., 0] < 0) | (fraction[..., 0] > 1) | (span > LARGEST_GAP)).nonzero()
        share = (1 - fraction[..., 0]) ** 2 + fraction[..., 0] ** 2
        if len(beside[0]):
            seconds = (at[beside] - stamps[beside[1]]) * 1e-9
            motion[beside], share[beside] = extrapolated(own[beside[1], :9], seconds), 1.0
        self._sum(stamps, motion, own[:, WRENCH], share)

    def _sum(self, stamps: Stamps, motion: Array, wrench: Array, share: Array) -> None:
        """Sum (N,) samples with their motion (L, N, 9) and shares of noise (L, N) into blocks."""
        number = stamps // self._block
        first = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
        which = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(stamps))))
        place = np.arange(len(stamps)) - first[which]
        rows = np.zeros((len(first), len(motion), place.max() + 1, N_SIGNALS))
        signals = motion_signals(motion[..., SPECIFIC], motion[..., OMEGA], motion[..., ALPHA])
        rows[which, :, place, :N_MOTION] = signals.swapaxes(0, 1)
        rows[which, :, place, N_MOTION:] = wrench[:, None]
        self._store.append(
            MomentBlocks(
                rows.swapaxes(2, 3) @ rows,
                np.add.reduceat(share, first, axis=1).T,
                np.diff(np.append(first, len(stamps))),
                stamps[first],
                stamps[np.append(first[1:], len(stamps)) - 1],
            )
        )


def extrapolated(motion: Array, seconds: Array) -> Array:
    """Motion (N, 9) some time (N,) later, or before: the angular acceleration stays, and the world's axes turn away.

    That is what is left at the ends of a recording and beside gaps; over the longest lag it is off by a milliradian.
    """
    time = seconds[:, None]
    omega, alpha = motion[:, OMEGA], motion[:, ALPHA]
    turn = omega * time + alpha * time**2 / 2
    once = np.cross(turn, motion[:, SPECIFIC])
    specific = motion[:, SPECIFIC] - once + np.cross(turn, once) / 2
    return np.concatenate([specific, omega + alpha * time, alpha], axis=1)
