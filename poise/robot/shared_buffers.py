"""The tracks of one source, each worked out once for all methods that want it."""

from dataclasses import fields
from functools import cached_property

import numpy as np

from poise.robot.live_imu import LiveImu, MotionWithImu
from poise.robot.low_latency import LowLatencyMotion
from poise.robot.motion import SensorMotion
from poise.robot.motion_buffers import (
    USED,
    MotionBuffer,
    PairingReasons,
    PairingSettings,
    SmoothedMotion,
    StaticPoseBuffer,
)
from poise.robot.sources import MotionSource
from poise.types import Mask, Stamps

_SHORTLY, _OFTEN = 100_000_000, 5
"""ns; poses within this time on both sides together from which on they come often."""


class SharedBuffers:
    """Made as they are asked for.

    Args:
        source: of the kinematics.
        settings: how wrenches and motion are brought together.
        imu: knows the linear acceleration; None: the source does.
    """

    def __init__(self, source: MotionSource, settings: PairingSettings, imu: LiveImu | None = None) -> None:
        self._source, self._settings, self._imu = source, settings, imu
        self._made: list[MotionBuffer] = []

    def update(self, flush: bool) -> None:
        """See `MotionBuffer`."""
        for track in self._made:
            track.update(flush)

    def forget_before(self, stamp: int) -> None:
        """Drop older motion, and what the source no longer has to keep."""
        needed = [track.needs_from() for track in self._made]
        for track in self._made:
            track.forget_before(stamp)
        self._source.forget_before(min([stamp, *(begin for begin in needed if begin is not None)]))

    @cached_property
    def still(self) -> StaticPoseBuffer:
        self._made.append(track := StaticPoseBuffer(self._source, self._settings))
        return track

    @cached_property
    def moving(self) -> MotionBuffer:
        return self._kept(SmoothedMotion(self._source, self._settings))

    @cached_property
    def fresh(self) -> MotionBuffer:
        return self._kept(LowLatencyMotion(self._source, self._settings))

    @cached_property
    def either(self) -> "MovingOrStatic":
        return MovingOrStatic(self.moving, self.still, None if self._imu is None else self._source)

    def _kept(self, track: MotionBuffer) -> MotionBuffer:
        track = track if self._imu is None else MotionWithImu(track, self._imu)
        self._made.append(track)
        return track


class MovingOrStatic:
    """The smoothed motion where there is one, and poses held still where there is not.

    A motion that is smoothed knows more; but poses may come so rarely that there is none. The two are kept up to date
    by whoever made them.

    Args:
        moving: the smoothed motion.
        still: held poses.
        measured: source of poses whose linear acceleration an IMU measures; None: there is no IMU. An IMU at rest
            measures its offset. Where poses come often, all samples thus have the motion with the IMU, or none.
    """

    def __init__(self, moving: MotionBuffer, still: StaticPoseBuffer, measured: MotionSource | None = None) -> None:
        self._moving, self._still, self._measured = moving, still, measured

    @property
    def decided(self) -> int | None:
        """Up to which stamp (ns) `pair` has its final answer; None before anything is known."""
        known = self._moving.decided, self._still.decided
        return None if known[0] is None or known[1] is None else min(known[0], known[1])

    def update(self, flush: bool = False) -> None:
        """Nothing to do."""

    def pair(self, stamps: Stamps) -> tuple[SensorMotion, PairingReasons]:
        motion, reasons = self._moving.pair(stamps)
        missing = np.flatnonzero(reasons != USED)
        if not len(missing):
            return motion, reasons
        rest, at_rest = self._still.pair(stamps[missing])
        still = at_rest == USED
        if self._measured is not None:
            still &= ~self._comes_often(self._measured, stamps[missing])
        held = missing[still]
        columns = []
        for field in fields(SensorMotion):
            values = np.array(getattr(motion, field.name))
            values[held] = getattr(rest, field.name)[still]
            columns.append(values)
        reasons[held] = USED
        return SensorMotion(*columns), reasons

    @staticmethod
    def _comes_often(source: MotionSource, stamps: Stamps) -> Mask:
        """(N,) there are poses shortly before or after each stamp: only the ends of the smoothed motion are missing."""
        poses = source.stamps(int(stamps[0]) - _SHORTLY, int(stamps[-1]) + _SHORTLY)
        around = np.searchsorted(poses, stamps + _SHORTLY) - np.searchsorted(poses, stamps - _SHORTLY)
        return np.asarray(around >= _OFTEN)

    def forget_before(self, stamp: int) -> None:
        """Nothing to forget."""

    def needs_from(self) -> int | None:
        return None
