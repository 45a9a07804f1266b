"""Samples in, one by one or many at once: paired with the motion at every lag, and summed into blocks."""

import numpy as np

from poise.geometry import cross
from poise.inertia.bayes.blocks import BLOCK, BlockStore, MomentBlocks
from poise.inertia.bayes.delay import LagGrid
from poise.inertia.model import N_MOTION, N_SIGNALS, motion_signals
from poise.robot import SensorMotion
from poise.types import Array, Mask, Stamps

LARGEST_GAP = 100_000_000
"""ns between kinematics across which nothing is interpolated."""

CHUNK = 64
"""Samples that wait before they are summed; together they cost little more than one."""

_PORTION = 4096
"""Samples that are in memory at all lags at once."""

SPECIFIC, OMEGA, ALPHA, WRENCH = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 15)
"""Columns of a sample: g - a, omega, alpha, wrench."""


class BlockRecorder:
    """Pairs each wrench with the motion at every lag, and sums them into blocks.

    Blocks are cut by the stamps alone, and the weight of a sample does not depend on the portion that it came in. So
    the portions do not matter.

    Args:
        grid: the lags.
        block: ns of a block.
    """

    def __init__(self, grid: LagGrid, block: int = BLOCK) -> None:
        self.grid = grid
        self._block = block
        self._new: list[tuple[Stamps, Array, Mask]] = []
        self._n_new = 0
        # Samples in memory, as neighbours of others, and how many of the newest have not been summed for good.
        self._stamps, self._rows = np.zeros(0, dtype=np.int64), np.zeros((0, 15))
        self._usable = np.zeros(0, dtype=bool)
        self._n_waiting = 0
        self._store = BlockStore(len(grid), block)

    @property
    def blocks(self) -> MomentBlocks:
        """All of them. The last ones may still grow; the motion after the newest samples is extrapolated."""
        self._flush()
        self._store.rewind()
        self._store.mark()
        self._pair(self._n_waiting)
        return self._store.blocks

    def add(self, stamps: Stamps, rows: Array, usable: Mask) -> None:
        """Add samples in the order of time.

        Args:
            stamps: (N,) ns, increasing.
            rows: (N, 15) g - a, omega, alpha and the wrench; SI, in the sensor frame. The motion is finite.
            usable: (N,) whether the wrench may be used; the motion serves its neighbours in any case.
        """
        self._new.append((stamps, rows, usable))
        self._n_new += len(stamps)
        if self._n_new >= CHUNK:
            self._flush()

    def _flush(self) -> None:
        """Take in what has come, and sum the wrenches around which the motion is known by now."""
        if not self._n_new:
            return
        self._store.rewind()
        stamps, rows, usable = (np.concatenate(columns) for columns in zip(*self._new, strict=True))
        self._new, self._n_new = [], 0
        for begin in range(0, len(stamps), _PORTION):
            some = slice(begin, begin + _PORTION)
            self._take(stamps[some], rows[some], usable[some])

    def _take(self, stamps: Stamps, rows: Array, usable: Mask) -> None:
        self._stamps = np.concatenate([self._stamps, stamps])
        self._rows = np.concatenate([self._rows, rows])
        self._usable = np.concatenate([self._usable, usable])
        self._n_waiting += len(stamps)
        if not self._n_waiting:
            return
        waiting = self._stamps[-self._n_waiting :]
        ready = int(np.searchsorted(waiting, self._stamps[-1] + min(self.grid.nanoseconds[0], 0), "right"))
        # Whole blocks alone, so that rounding does not depend on the portions either.
        unfinished = waiting[min(ready, len(waiting) - 1)] // self._block
        ready = int(np.searchsorted(waiting // self._block, unfinished, "left"))
        self._pair(ready)
        self._n_waiting -= ready
        # Neighbours on both sides of the longest lag are remembered.
        oldest = max(len(self._stamps) - self._n_waiting, 1) - 1
        past = self._stamps[oldest] - max(self.grid.nanoseconds[-1], 0)
        begin = max(int(np.searchsorted(self._stamps, past, "left")) - 1, 0)
        self._stamps, self._rows = self._stamps[begin:], self._rows[begin:]
        self._usable = self._usable[begin:]

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


def sample_rows(motion: SensorMotion, wrench: Array, gravity: Array) -> Array:
    """(N, 15) rows for a `BlockRecorder`, of a motion, the wrenches (N, 6) and gravity (3,) m/s2 in the world."""
    return np.hstack(
        [
            motion.gravity_in_sensor(gravity) - motion.linear_acceleration_in_sensor,
            motion.angular_velocity_in_sensor,
            motion.angular_acceleration_in_sensor,
            wrench,
        ]
    )


def extrapolated(motion: Array, seconds: Array) -> Array:
    """Motion (N, 9) some time (N,) later, or before: the angular acceleration stays, and the world's axes turn away.

    That is what is left at the ends of a recording and beside gaps; over the longest lag it is off by a milliradian.
    """
    time = seconds[:, None]
    omega, alpha = motion[:, OMEGA], motion[:, ALPHA]
    turn = omega * time + alpha * time**2 / 2
    once = cross(turn, motion[:, SPECIFIC])
    specific = motion[:, SPECIFIC] - once + cross(turn, once) / 2
    return np.concatenate([specific, omega + alpha * time, alpha], axis=1)
