"""An IMU on the running robot: what the sensor's motion lacks of linear acceleration, measured."""

import numpy as np
from numpy.typing import ArrayLike

from poise.geometry import Pose
from poise.robot.frame_tree import FrameTree
from poise.robot.imu import Imu
from poise.robot.motion import SensorMotion
from poise.robot.motion_buffers import NO_KINEMATICS, USED, MotionBuffer, PairingReasons
from poise.robot.scatter import ScatterMeter
from poise.robot.stamped_buffer import StampedBuffer
from poise.types import Array, Stamps

IMU_LONGEST_DELAY, IMU_LAG_STEP = 0.012, 0.003
"""s, see `PoiseEstimator`: an IMU follows vibrations, and a delay of a whole period of one looks like none."""


class LiveImu:
    """Samples of an IMU that rides on the sensor, as they come.

    Args:
        frames: with its mounting.
        gravity: (3,) m/s2 in the world.
        topic: where its messages come from.
    """

    def __init__(self, frames: FrameTree, gravity: Array, topic: str = "imu") -> None:
        self.gravity = gravity
        self.frame_id = ""
        self._frames, self._topic = frames, topic
        self._mounting = Pose.identity()
        self._buffer = StampedBuffer(3)
        self._scatter = ScatterMeter()

    @property
    def noise(self) -> float:
        """m/s2, one sigma of a sample, of all that has come; NaN for too few."""
        return self._scatter.value

    @property
    def newest(self) -> int | None:
        """Its last stamp, ns."""
        return self._buffer.newest

    @property
    def words(self) -> str:
        """For people."""
        return f"linear acceleration from {self._topic} ({self.frame_id})"

    def add(self, stamp: int, frame_id: str, acceleration: ArrayLike) -> None:
        """Take what it measured (3,) m/s2 in its own axes, gravity's reaction included."""
        measured = np.asarray(acceleration, dtype=np.float64)
        if np.isfinite(measured).all() and frame_id == (self.frame_id or frame_id):
            self.frame_id = frame_id
            self._buffer.extend(np.array([stamp], dtype=np.int64), measured[None])
            self._scatter.add(measured[None])

    def take(self, imu: Imu) -> None:
        """Take all samples of an IMU whose axes are those of the sensor."""
        self.frame_id = imu.frame_id
        self._mounting = Pose(np.eye(3), imu.place)
        self._buffer.extend(imu.stamps, -imu.specific)
        self._scatter.add(imu.specific)

    def rides_on(self, sensor_frame: str) -> bool:
        """Whether it has spoken, and tf_static joins it to the sensor; from then on it is known how it is mounted."""
        mounting = self._frames.pose(self.frame_id, sensor_frame, fixed_only=True)
        if self.newest is None or mounting is None:
            return False
        self._mounting = mounting
        return True

    @property
    def measured(self) -> Imu:
        """What is remembered, in sensor axes."""
        rotation, place = self._mounting.rotation, self._mounting.translation
        stamps, rows = self._buffer.stamps, self._buffer.rows
        later = np.diff(stamps, prepend=-1) > 0
        specific = -rows[later] @ rotation.T
        return Imu(stamps[later], specific, np.full_like(specific, np.nan), place, self.frame_id, self._topic)

    def forget_before(self, stamp: int) -> None:
        """Drop what is older."""
        self._buffer.forget_before(stamp)

    def keep_last(self, seconds: float) -> None:
        """Drop what is older than the newest by more."""
        if self.newest is not None:
            self._buffer.forget_before(self.newest - round(seconds * 1e9))

    def clear(self) -> None:
        """Drop all: time has jumped."""
        self._buffer.clear()


class MotionWithImu:
    """Motion as another track knows it, but with the linear acceleration that an IMU measured."""

    def __init__(self, track: MotionBuffer, imu: LiveImu) -> None:
        self._track, self._imu = track, imu

    @property
    def decided(self) -> int | None:
        """See `MotionBuffer`."""
        known = self._track.decided, self._imu.newest
        return None if known[0] is None or known[1] is None else min(known[0], known[1])

    def update(self, flush: bool = False) -> None:
        """See `MotionBuffer`."""
        self._track.update(flush)

    def pair(self, stamps: Stamps) -> tuple[SensorMotion, PairingReasons]:
        """See `MotionBuffer`."""
        motion, reasons = self._track.pair(stamps)
        motion = self._imu.measured.applied(motion, self._imu.gravity)
        known = np.isfinite(motion.linear_acceleration_in_sensor).all(axis=1)
        reasons[(reasons == USED) & np.logical_not(known)] = NO_KINEMATICS
        return motion, reasons

    def forget_before(self, stamp: int) -> None:
        """See `MotionBuffer`."""
        self._track.forget_before(stamp)
        self._imu.forget_before(stamp)

    def needs_from(self) -> int | None:
        """See `MotionBuffer`."""
        return self._track.needs_from()
