"""An inertial measurement unit on the sensor: specific force, measured instead of derived from positions."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import scipy

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.recording import Recording, interpolate
from poise.robot.differentiation import differentiate
from poise.robot.frame_tree import FrameTree
from poise.robot.motion import SensorMotion
from poise.robot.recorded_frames import frames_above, is_constant
from poise.robot.scatter import scatter
from poise.robot.sources import StampedPoses
from poise.types import Array, Stamps

_LARGEST_GAP = 0.1
"""s between samples across which nothing is interpolated."""


@dataclass(frozen=True, eq=False)
class Imu:
    """Samples of an IMU in sensor axes.

    Args:
        stamps: (N,) int64 ns, increasing.
        specific: (N, 3) g - a at the IMU's own place, m/s2: the measured acceleration, turned around.
        angular_velocity: (N, 3) rad/s, NaN where it has no gyroscope.
        place: (3,) m in the sensor frame.
        frame_id: its own frame.
        topic: where it was recorded.
    """

    stamps: Stamps
    specific: Array
    angular_velocity: Array
    place: Array
    frame_id: str
    topic: str

    @property
    def words(self) -> str:
        """For people."""
        return f"linear acceleration from {self.topic} ({self.frame_id})"

    @property
    def noise(self) -> float:
        """m/s2, one sigma of a sample."""
        found = scatter(self.specific)
        return found if np.isfinite(found) else 0.05

    def applied(self, motion: SensorMotion, gravity: Array) -> SensorMotion:
        """The same motion with this linear acceleration of the sensor's origin; NaN where there is none.

        A point at r feels a + alpha x r + omega x (omega x r).
        """
        specific = interpolate(self.stamps, self.specific, motion.stamps, max_gap=_LARGEST_GAP).values
        omega, alpha = motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor
        by_turning = np.cross(alpha, self.place) + np.cross(omega, np.cross(omega, self.place))
        linear = motion.gravity_in_sensor(gravity) - specific - by_turning
        return replace(motion, linear_acceleration_in_sensor=linear)


class ImuSource:
    """The motion of a sensor from nothing but an IMU with a gyroscope; its heading is not known, nor needed.

    Attitudes are integrated from the angular velocity and drift; the linear acceleration is what they leave of the
    specific force and drifts as well. Their difference, which is all that the wrench of a load knows, does not.

    Args:
        imu: with angular velocities.

    Raises:
        InputError: TOPIC_MISSING when it has none.
    """

    jumps, has_positions = 0, True

    def __init__(self, imu: Imu, gravity: float) -> None:
        known = np.isfinite(imu.angular_velocity).all(axis=1)
        if not known.any():
            raise InputError(
                ErrorCode.TOPIC_MISSING,
                f"{imu.topic} has no angular velocity, and no other topic gives the sensor's attitude: record tf up"
                " to it, or joint_states with robot_description",
            )
        self._imu = replace(
            imu, stamps=imu.stamps[known], specific=imu.specific[known], angular_velocity=imu.angular_velocity[known]
        )
        self._gravity = gravity
        self._rotation = _integrated(self._imu)

    @property
    def words(self) -> str:
        return f"{self._imu.topic} ({self._imu.frame_id}) alone"

    @property
    def newest(self) -> int | None:
        return int(self._imu.stamps[-1]) if len(self._imu.stamps) else None

    def stamps(self, begin: int, end: int) -> Stamps:
        return self._imu.stamps[self._between(begin, end)]

    def poses(self, begin: int, end: int) -> StampedPoses:
        inside = self._between(begin, end)
        rotation = self._rotation[inside]
        return StampedPoses(rotation, np.zeros((len(rotation), 3)), self._imu.stamps[inside])

    def motion(self, begin: int, end: int, margin: int = 0) -> SensorMotion:
        part, inside = self._between(begin - margin, end + margin), self._between(begin, end)
        turning = differentiate(self._imu.stamps[part], self._imu.angular_velocity[part], within=(begin, end))
        known = np.isfinite(turning.velocity).all(axis=1)
        rotation, still = self._rotation[inside][known], np.zeros((int(known.sum()), 3))
        motion = SensorMotion(turning.stamps[known], rotation, turning.position[known], turning.velocity[known], still)
        return self._imu.applied(motion, np.array([0.0, 0.0, -self._gravity]))

    def forget_before(self, stamp: int) -> None:
        """All samples stay in memory."""

    def clear(self) -> None:
        """A recorded IMU does not start over."""

    def _between(self, begin: int, end: int) -> slice:
        low, high = np.searchsorted(self._imu.stamps, [begin, end + 1])
        return slice(int(low), int(high))


def find_imu(recording: Recording, sensor_frame: str, topic: str = "imu") -> Imu | None:
    """The IMU that is fixed to the sensor; None when there is none, or its mounting is unknown."""
    try:
        stream = recording.imu(topic)
    except InputError as error:
        if error.code is ErrorCode.TOPIC_MISSING:
            return None
        raise
    mounting = _mounting(recording, stream.frame_id, sensor_frame)
    good = np.isfinite(stream.linear_acceleration).all(axis=1) & (np.diff(stream.stamps, prepend=-1) > 0)
    if mounting is None or not good.any():
        return None
    rotation, place = mounting.rotation, mounting.translation
    return Imu(
        stream.stamps[good],
        -stream.linear_acceleration[good] @ rotation.T,
        stream.angular_velocity[good] @ rotation.T,
        place,
        stream.frame_id,
        topic,
    )


def _mounting(recording: Recording, frame: str, sensor_frame: str) -> Pose | None:
    """Where the IMU is in the sensor frame, when what lies between them does not move."""
    tree = FrameTree(one_parent=False, keep=False)
    for name in (frame, sensor_frame):
        for stream in frames_above(recording, name):
            if is_constant(stream):
                turns, shifts = stream.rotation_parent_child[-1:], stream.translation_parent_child[-1:]
                tree.add(stream.stamps[-1:], stream.parent, stream.child, turns, shifts, fixed=True)
    return tree.pose(frame, sensor_frame, fixed_only=True)


def _integrated(imu: Imu) -> Array:
    """(N, 3, 3) attitudes, world <- sensor, from the angular velocity; the first one upright by the specific force."""
    up = -imu.specific[0] / np.linalg.norm(imu.specific[0])
    start = scipy.spatial.transform.Rotation.align_vectors([[0.0, 0.0, 1.0]], up[None])[0].as_matrix()
    omega = (imu.angular_velocity[1:] + imu.angular_velocity[:-1]) / 2
    steps = scipy.spatial.transform.Rotation.from_rotvec(omega * (np.diff(imu.stamps) * 1e-9)[:, None]).as_matrix()
    return np.array(list(itertools.accumulate(steps, np.matmul, initial=start)))
