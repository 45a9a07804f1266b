"""A source of motion that also notes how uncertain the accelerations are that it gives."""

from dataclasses import replace

import numpy as np

from poise.inertia.estimators import LEAST_NOISE
from poise.inertia.model import NoiseLevels
from poise.robot import FrameSource, JointSource, MotionSource, SensorMotion, StampedPoses
from poise.types import Stamps

_MOST_STRETCHES = 16
"""Stretches of motion whose noise is measured, because that takes long; of more, every second one, then every fourth
and so on. Which ones depends on the motion alone, so that a recording and the same messages live give the same."""


class MeasuringSource:
    """Hands on everything, and remembers the noise of each stretch of motion."""

    def __init__(self, source: MotionSource) -> None:
        self.jumps = 0
        self._source = source
        self._variances: list[tuple[float, float]] = []
        self._n_stretches, self._stride = 0, 1

    @property
    def noise(self) -> NoiseLevels:
        """Of the accelerations; the rest are defaults."""
        if not isinstance(self._source, JointSource | FrameSource):
            return NoiseLevels()
        if not self._variances:  # only held poses are used
            return LEAST_NOISE
        linear, angular = np.sqrt(np.median(self._variances, axis=0)).tolist()
        return replace(
            NoiseLevels(),
            linear_acceleration=max(linear, LEAST_NOISE.linear_acceleration),
            angular_acceleration=max(angular, LEAST_NOISE.angular_acceleration),
        )

    @property
    def words(self) -> str:
        """See `MotionSource`."""
        return self._source.words

    @property
    def has_positions(self) -> bool:
        """See `MotionSource`."""
        return self._source.has_positions

    @property
    def newest(self) -> int | None:
        """See `MotionSource`."""
        return self._source.newest

    def stamps(self, begin: int, end: int) -> Stamps:
        """See `MotionSource`."""
        return self._source.stamps(begin, end)

    def poses(self, begin: int, end: int) -> StampedPoses:
        """See `MotionSource`."""
        return self._source.poses(begin, end)

    def motion(self, begin: int, end: int, margin: int = 0) -> SensorMotion:
        """See `MotionSource`."""
        if not isinstance(self._source, JointSource | FrameSource):
            return self._source.motion(begin, end, margin)
        wanted = self._n_stretches % self._stride == 0
        measured = self._source.measured(begin, end, margin, errors=wanted)
        moving = measured.motion.angular_velocity_in_sensor.any(axis=1)  # at rest the acceleration is known better
        if moving.any():
            if wanted:
                sigmas = measured.linear_acceleration_sigma, measured.angular_acceleration_sigma
                linear, angular = (float(np.median(sigma[moving] ** 2)) for sigma in sigmas)
                self._variances.append((linear, angular))
            self._n_stretches += 1
            if len(self._variances) > _MOST_STRETCHES:
                self._variances, self._stride = self._variances[::2], 2 * self._stride
        return measured.motion

    def forget_before(self, stamp: int) -> None:
        """See `MotionSource`."""
        self._source.forget_before(stamp)

    def clear(self) -> None:
        """See `MotionSource`."""
        self._source.clear()
