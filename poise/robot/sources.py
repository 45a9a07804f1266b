"""Where the sensor's motion comes from: joint states through a robot model, or a chain of tf frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, are_rotations
from poise.recording import interpolate, interpolate_rotations
from poise.robot.differentiation import differentiate
from poise.robot.frame_tree import FrameTree
from poise.robot.kinematics import frame_poses
from poise.robot.measured import MeasuredMotion, motion_from_derivatives, motion_from_poses
from poise.robot.model import RobotModel
from poise.robot.motion import SensorMotion
from poise.robot.odometry import base_from_odometry
from poise.robot.stamped_buffer import StampedBuffer, went_back
from poise.robot.turns import without_turns
from poise.types import Stamps

_ODOMETRY_GAP = 0.5
"""s between samples of odometry across which poses are interpolated."""


@dataclass(frozen=True, eq=False)
class StampedPoses(Pose):
    """Poses (N) of the sensor in a gravity-aligned frame, and their stamps (N,) ns."""

    stamps: Stamps


class MotionSource(Protocol):
    """Kinematics in memory, asked for stretches of time (int ns, both ends included)."""

    @property
    def words(self) -> str:
        """For people: what it is."""

    @property
    def has_positions(self) -> bool:
        """False: only attitudes are known, and no linear acceleration."""

    @property
    def newest(self) -> int | None:
        """Up to which stamp the kinematics are known."""

    def stamps(self, begin: int, end: int) -> Stamps:
        """Those of the samples."""

    def poses(self, begin: int, end: int) -> StampedPoses:
        """As sampled, not smoothed."""

    def motion(self, begin: int, end: int, margin: int = 0) -> SensorMotion:
        """Smoothed, with rates; the samples for which there are any. Samples up to `margin` ns outside take part.

        Raises:
            InputError: TOO_FEW_SAMPLES.
        """

    def forget_before(self, stamp: int) -> None:
        """Drop what is older."""

    def clear(self) -> None:
        """Drop all samples: time has jumped."""

    @property
    def jumps(self) -> int:
        """How often the stamps went back by more than messages can be late."""


class JointSource:
    """Joint states of a robot whose root link is upright and at rest, or is moved by odometry.

    Args:
        model: the robot, with its sensor frame; with a floating base, odometry has to be added too.

    Raises:
        InputError: ROBOT_DESCRIPTION_INVALID when no joint moves the sensor.
    """

    has_positions = True

    def __init__(self, model: RobotModel) -> None:
        if not model.joint_names:
            raise InputError(
                ErrorCode.ROBOT_DESCRIPTION_INVALID,
                f"robot description: no joint moves {model.sensor_frame}; name the frame of the sensor at the wrist",
            )
        self.model = model
        self._buffer = StampedBuffer(2 * len(model.joint_names))
        self._odometry = StampedBuffer(12) if model.base == "floating" else None
        self.foreign = 0
        """Messages that lack joints of this robot: another robot's, or a gripper's."""
        self.not_finite = 0
        """Messages with a joint position that is not finite."""
        self.jumps = 0

    @property
    def words(self) -> str:
        base = "" if self._odometry is None else " with odom"
        return f"joint_states{base} and the robot description ({self.model.base_frame} to {self.model.sensor_frame})"

    def extend(
        self, stamps: ArrayLike, names: Sequence[str], position: ArrayLike, velocity: ArrayLike | None = None
    ) -> bool:
        """Add joint states; what lacks joints of this robot, or holds no number, is counted and left out.

        Args:
            stamps: (N,) int64 ns.
            names: (K) joints of the columns.
            position: (N, K) rad or m.
            velocity: (N, K) rad/s or m/s, NaN or None where not measured.

        Returns:
            Whether any of them is used.
        """
        times = np.asarray(stamps, dtype=np.int64)
        places = np.asarray(position, dtype=np.float64)
        rates = np.full(places.shape, np.nan) if velocity is None else np.asarray(velocity, dtype=np.float64)
        if not set(self.model.joint_names) <= set(names) or places.shape != (len(times), len(names)):
            self.foreign += len(times)
            return False
        if rates.shape != places.shape:
            rates = np.full(places.shape, np.nan)
        places, rates = self.model.order(names, places, rates)
        finite = np.isfinite(places).all(axis=1)
        self.not_finite += int(np.count_nonzero(~finite))
        if finite.any():
            if went_back(times[finite], self._buffer.newest):
                self.jumps += 1
                self.clear()
            self._buffer.extend(times[finite], np.hstack([places, rates])[finite])
        return bool(finite.any())

    def add_odometry(self, stamps: ArrayLike, rotation: ArrayLike, translation: ArrayLike) -> None:
        """Add poses of the root link in the world, for a model with a floating base; invalid ones are left out.

        Args:
            stamps: (N,) int64 ns.
            rotation: (N, 3, 3).
            translation: (N, 3) m.
        """
        turns, shifts = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
        good = are_rotations(turns) & np.isfinite(shifts).all(axis=1)
        self.not_finite += int(np.count_nonzero(~good))
        if self._odometry is not None:
            rows = np.hstack([turns.reshape(-1, 9), shifts])
            self._odometry.extend(np.asarray(stamps, dtype=np.int64)[good], rows[good])

    @property
    def newest(self) -> int | None:
        if self._odometry is None or self._buffer.newest is None or self._odometry.newest is None:
            return self._buffer.newest if self._odometry is None else None
        return min(self._buffer.newest, self._odometry.newest)

    def stamps(self, begin: int, end: int) -> Stamps:
        return self._buffer.between(begin, end)[0]

    def poses(self, begin: int, end: int) -> StampedPoses:
        stamps, rows = self._buffer.between(begin, end)
        pose = Pose(*frame_poses(self.model, np.hsplit(rows, 2)[0]))
        if self._odometry is None:
            return StampedPoses(pose.rotation, pose.translation, stamps)
        samples, odometry = self._odometry.stamps, self._odometry.rows
        turns = interpolate_rotations(samples, odometry[:, :9], stamps, max_gap=_ODOMETRY_GAP)
        shifts = interpolate(samples, odometry[:, 9:], stamps, max_gap=_ODOMETRY_GAP)
        pose, known = Pose(turns.values, shifts.values) @ pose, turns.found
        return StampedPoses(pose.rotation[known], pose.translation[known], stamps[known])

    def motion(self, begin: int, end: int, margin: int = 0) -> SensorMotion:
        return self.measured(begin, end, margin, errors=False).motion

    def measured(self, begin: int, end: int, margin: int = 0, errors: bool = True) -> MeasuredMotion:
        """The motion with its uncertainty; NaN without `errors`."""
        first, last = begin - margin, end + margin
        stamps, rows = self._buffer.between(first, last)
        position, velocity = np.hsplit(rows, 2)
        whole = without_turns(stamps * 1e-9, position)
        joints = differentiate(stamps, whole, velocity, within=(begin, end), errors=errors)
        base = None
        if self._odometry is not None:
            samples, odometry = self._odometry.between(first, last)
            base = base_from_odometry(samples, odometry[:, :9].reshape(-1, 3, 3), odometry[:, 9:], joints.stamps)
        return motion_from_derivatives(self.model, joints, base)

    def forget_before(self, stamp: int) -> None:
        for buffer in self._buffers:
            buffer.forget_before(stamp)

    def clear(self) -> None:
        for buffer in self._buffers:
            buffer.clear()

    @property
    def _buffers(self) -> list[StampedBuffer]:
        return [self._buffer] if self._odometry is None else [self._buffer, self._odometry]


class FrameSource:
    """Transforms from tf, from a gravity-aligned frame to the sensor.

    Args:
        sensor_frame: the frame that is measured in.
        base_frame: the gravity-aligned frame; None: the topmost in tf.
        max_gap: s between samples of a transform across which it is not interpolated.
    """

    def __init__(self, sensor_frame: str, base_frame: str | None = None, max_gap: float = 0.2) -> None:
        self.sensor_frame = sensor_frame
        self.base_frame = base_frame
        self.tree = FrameTree(max_gap=max_gap)
        self.extend = self.tree.add
        """Adds transforms, see `FrameTree.add`."""

    @property
    def words(self) -> str:
        lack = "" if self.has_positions else "; attitudes only: linear accelerations are taken as zero"
        return f"tf ({self._top} to {self.sensor_frame}{lack})"

    @property
    def not_finite(self) -> int:
        """Transforms that are not a rigid motion, or not finite."""
        return self.tree.not_finite

    @property
    def jumps(self) -> int:
        return self.tree.jumps

    @property
    def has_positions(self) -> bool:
        """Some transform has a translation; without any only attitudes were recorded."""
        return self.tree.has_positions

    @property
    def newest(self) -> int | None:
        return self.tree.newest(self._path)

    def stamps(self, begin: int, end: int) -> Stamps:
        # Those of the moving transform next to the sensor.
        return self.tree.stamps(self._path, begin, end)

    def poses(self, begin: int, end: int) -> StampedPoses:
        stamps = self.stamps(begin, end)
        reference = self._top if len(stamps) else self.sensor_frame
        pose, known = self.tree.poses(self.sensor_frame, reference, stamps)
        return StampedPoses(pose.rotation[known], pose.translation[known], stamps[known])

    def motion(self, begin: int, end: int, margin: int = 0) -> SensorMotion:
        return self.measured(begin, end, margin, errors=False).motion

    def measured(self, begin: int, end: int, margin: int = 0, errors: bool = True) -> MeasuredMotion:
        """The motion with its uncertainty; NaN without `errors`."""
        poses = self.poses(begin - margin, end + margin)
        return motion_from_poses(poses.stamps, poses.rotation, poses.translation, within=(begin, end), errors=errors)

    def forget_before(self, stamp: int) -> None:
        self.tree.forget_before(stamp)

    def keep_last(self, seconds: float) -> None:
        """Of each transform, drop what is older than its newest by more."""
        self.tree.keep_last(seconds)

    def clear(self) -> None:
        self.tree.clear()

    @property
    def _path(self) -> list[str]:
        """Frames below the base down to the sensor; empty while they do not connect."""
        return self.tree.path(self.sensor_frame, self.base_frame)

    @property
    def _top(self) -> str:
        """The gravity-aligned frame."""
        return self.base_frame or self.tree.top(self.sensor_frame)
