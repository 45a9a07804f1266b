"""The samples of a weighing, averaged in bins of time: enough to judge its fit, and never more than a fixed number."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from poise.inertia.model import N_MOTION, RejectedInterval, motion_signals
from poise.robot import SensorMotion
from poise.types import Array, Mask, Stamps

_WIDTH = 10_000_000
"""ns: the first width of a bin."""

_MOST_BINS = 1_000
"""With more of them, neighbours are merged."""

_MOST_WAITING = 4_096
"""Samples that wait to be averaged."""

_RADIUS = 0.5
"""m from a sensor to the axes that it turns about."""

_TIME, _ROTATION, _SIGNALS, _WRENCH = 1, slice(2, 11), slice(11, 24), slice(24, 30)
"""Columns of the sums; the first column counts."""


@dataclass(frozen=True, eq=False)
class FitSamples:
    """Averages of the used samples over bins of time. The wrench is linear in these signals: averages are exact.

    Args:
        stamps: (B,) int64 ns, mean.
        counts: (B,) samples in each.
        rotation_world_sensor: (B, 3, 3) mean; a rotation as far as the sensor turns little within a bin.
        signals: (B, 13) see `motion_signals`.
        wrench: (B, 6) N and N m.
        gravity: (3,) m/s2 in the world.
    """

    stamps: Stamps
    counts: Array
    rotation_world_sensor: Array
    signals: Array
    wrench: Array
    gravity: Array

    def __len__(self) -> int:
        return len(self.stamps)

    @cached_property
    def seconds(self) -> Array:
        """(B,) s since the first bin."""
        return np.asarray((self.stamps - self.stamps[0]) * 1e-9) if len(self) else np.zeros(0)

    @cached_property
    def gravity_in_sensor(self) -> Array:
        """(B, 3) m/s2."""
        return np.asarray(np.einsum("bji,j->bi", self.rotation_world_sensor, self.gravity))

    @property
    def acceleration_in_sensor(self) -> Array:
        """(B, 3) m/s2 of the sensor's origin, without gravity."""
        return np.asarray(self.gravity_in_sensor - self.signals[:, :3])

    @property
    def usual_acceleration(self) -> float:
        """m/s2 root mean square, about what the sensor of an arm has while it turns so."""
        if not len(self):
            return 0.0
        turning = np.linalg.norm(self.signals[:, 3:6], axis=1) + self.signals[:, [6, 9, 11]].sum(axis=1)
        return float(_RADIUS * np.sqrt(np.mean(turning**2)))

    def outside(self, spans: Sequence[RejectedInterval]) -> Mask:
        """(B,) bins that do not lie within a span."""
        result = np.ones(len(self), dtype=bool)
        for span in spans:
            result &= (self.stamps < span.start) | (self.stamps > span.end)
        return result

    def delayed(self, delay: float) -> "FitSamples":
        """With the motion at the time at which the wrenches were measured, `delay` s before; NaN: as it is."""
        if not delay or not np.isfinite(delay) or not len(self):
            return self
        motion = np.column_stack([self.signals, self.rotation_world_sensor.reshape(-1, 9)])
        then = self.seconds - delay
        moved = np.column_stack([np.interp(then, self.seconds, column) for column in motion.T])
        return replace(self, signals=moved[:, :N_MOTION], rotation_world_sensor=moved[:, N_MOTION:].reshape(-1, 3, 3))

    def averaged(self, keys: Array) -> "FitSamples":
        """Neighbours with the same key (B,), not negative, as one bin."""
        if not len(self):
            return self
        begins = np.flatnonzero(np.diff(keys, prepend=-1.0))
        counts = np.add.reduceat(self.counts, begins)

        def mean(rows: Array) -> Array:
            shape = (-1, *[1] * (rows.ndim - 1))
            return np.asarray(np.add.reduceat(rows * self.counts.reshape(shape), begins) / counts.reshape(shape))

        stamps = self.stamps[0] + np.rint(mean(self.seconds) * 1e9).astype(np.int64)
        rotation = mean(self.rotation_world_sensor)
        return FitSamples(stamps, counts, rotation, mean(self.signals), mean(self.wrench), self.gravity)

    def select(self, which: Mask | NDArray[np.int64]) -> "FitSamples":
        """Some of the bins."""
        return FitSamples(
            self.stamps[which],
            self.counts[which],
            self.rotation_world_sensor[which],
            self.signals[which],
            self.wrench[which],
            self.gravity,
        )


class SampleBins:
    """Takes samples in the order of time; the portions in which they come do not matter.

    Args:
        gravity: (3,) m/s2 in the world.
    """

    def __init__(self, gravity: Array) -> None:
        self._gravity = gravity
        self._width = _WIDTH
        self._keys: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._sums = np.zeros((0, 30))
        self._first: int | None = None
        self._waiting: list[tuple[SensorMotion, Array]] = []
        self._n_waiting = 0

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        """Take wrenches (N, 6) with their motion."""
        self._waiting.append((motion, wrench))
        self._n_waiting += len(wrench)
        if self._n_waiting > _MOST_WAITING:
            self._average()

    @property
    def samples(self) -> FitSamples:
        """The averages so far."""
        self._average()
        means = self._sums / self._sums[:, :1]
        stamps = (self._first or 0) + np.rint(means[:, _TIME] * 1e9).astype(np.int64)
        rotation = means[:, _ROTATION].reshape(-1, 3, 3)
        return FitSamples(stamps, self._sums[:, 0], rotation, means[:, _SIGNALS], means[:, _WRENCH], self._gravity)

    def _average(self) -> None:
        for motion, wrench in self._waiting:
            self._add(motion, wrench)
        self._waiting, self._n_waiting = [], 0
        while len(self._keys) > _MOST_BINS:
            self._width *= 2
            self._merge(self._keys // 2, self._sums)

    def _add(self, motion: SensorMotion, wrench: Array) -> None:
        if self._first is None:
            self._first = int(motion.stamps[0])
        since = motion.stamps - self._first
        rows = np.empty((len(wrench), 30))
        rows[:, 0], rows[:, _TIME] = 1.0, since * 1e-9
        rows[:, _ROTATION] = motion.rotation_world_sensor.reshape(-1, 9)
        specific = motion.gravity_in_sensor(self._gravity) - motion.linear_acceleration_in_sensor
        omega, alpha = motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor
        rows[:, _SIGNALS] = motion_signals(specific, omega, alpha)
        rows[:, _WRENCH] = wrench
        keys = since // self._width
        self._merge(np.concatenate([self._keys, keys]), np.concatenate([self._sums, rows]))

    def _merge(self, keys: NDArray[np.int64], rows: Array) -> None:
        """Sum neighbours of one key."""
        begins = np.flatnonzero(np.diff(keys, prepend=keys[0] - 1))
        self._keys, self._sums = keys[begins], np.add.reduceat(rows, begins, axis=0)
