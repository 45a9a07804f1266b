"""Where the sensor's motion comes from: joint states through a robot model, or a chain of tf frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.recording.alignment import interpolate, interpolate_rotations
from poise.robot.kinematics import frame_poses
from poise.robot.measured import MeasuredMotion, motion_from_joints, motion_from_poses
from poise.robot.model import RobotModel
from poise.robot.motion import SensorMotion
from poise.robot.stamped_buffer import StampedBuffer
from poise.types import Array, Stamps

JUMP = 500_000_000
"""ns; stamps that go back by more are no late messages: the clock was set, or a recording started over."""


def went_back(stamps: Stamps, newest: int | None) -> bool:
    """New stamps (N,) lie so far before the newest one known that the clock must have been set back."""
    return newest is not None and bool(len(stamps)) and int(stamps[0]) < newest - JUMP


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the sensor in a gravity-aligned frame: (N,) ns, (N, 3, 3), (N, 3) m."""

    stamps: Stamps
    rotation: Array
    translation: Array


class MotionSource(Protocol):
    """Kinematics in memory, asked for stretches of time (int ns, both ends included)."""

    @property
    def words(self) -> str:
        """For people: what it is."""

    @property
    def newest(self) -> int | None:
        """Up to which stamp the kinematics are known."""

    def stamps(self, begin: int, end: int) -> Stamps:
        """Those of the samples."""

    def poses(self, begin: int, end: int) -> Poses:
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

    jumps: int
    """How often the stamps went back by more than messages can be late."""


class JointSource:
    """Joint states of a robot whose root link stands upright and still.

    Args:
        model: the robot, with its sensor frame.

    Raises:
        InputError: ROBOT_DESCRIPTION_INVALID when no joint moves the sensor.
    """

    def __init__(self, model: RobotModel) -> None:
        if not model.joint_names:
            raise InputError(
                ErrorCode.ROBOT_DESCRIPTION_INVALID,
                f"robot description: no joint moves {model.sensor_frame}; name the frame of the sensor at the wrist",
            )
        self.model = model
        self._buffer = StampedBuffer(2 * len(model.joint_names))
        self.foreign = 0
        """Messages that lack joints of this robot: another robot's, or a gripper's."""
        self.not_finite = 0
        """Messages with a joint position that is not finite."""
        self.jumps = 0

    @property
    def words(self) -> str:
        return f"joint_states and the robot description ({self.model.base_frame} to {self.model.sensor_frame})"

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

    @property
    def newest(self) -> int | None:
        return self._buffer.newest

    def stamps(self, begin: int, end: int) -> Stamps:
        return self._buffer.between(begin, end)[0]

    def poses(self, begin: int, end: int) -> Poses:
        stamps, rows = self._buffer.between(begin, end)
        return Poses(stamps, *frame_poses(self.model, np.hsplit(rows, 2)[0]))

    def motion(self, begin: int, end: int, margin: int = 0) -> SensorMotion:
        return self.measured(begin, end, margin, errors=False).motion

    def measured(self, begin: int, end: int, margin: int = 0, errors: bool = True) -> MeasuredMotion:
        """The motion with its uncertainty; NaN without `errors`."""
        stamps, rows = self._buffer.between(begin - margin, end + margin)
        position, velocity = np.hsplit(rows, 2)
        return motion_from_joints(
            self.model, stamps, self.model.joint_names, position, velocity, within=(begin, end), errors=errors
        )

    def forget_before(self, stamp: int) -> None:
        self._buffer.forget_before(stamp)

    def clear(self) -> None:
        self._buffer.clear()


class FrameSource:
    """Transforms from tf, from a gravity-aligned frame to the sensor.

    Args:
        sensor_frame: the frame that is measured in.
        base_frame: the gravity-aligned frame; None: the topmost that tf tells of.
        max_gap: s between samples of a transform across which it is not interpolated.
    """

    def __init__(self, sensor_frame: str, base_frame: str | None = None, max_gap: float = 0.2) -> None:
        self.sensor_frame = sensor_frame
        self.base_frame = base_frame
        self.max_gap = max_gap
        self.not_finite = 0
        """Transforms that are no rigid motion, or not finite."""
        self.jumps = 0
        self._parents: dict[str, str] = {}
        self._moving: dict[str, StampedBuffer] = {}
        self._fixed: dict[str, Array] = {}
        self._has_positions = False

    @property
    def words(self) -> str:
        chain = self._chain()
        top = self._parents[chain[0]] if chain else self.base_frame or "?"
        lack = "" if self._has_positions else "; attitudes only: linear accelerations are taken as zero"
        return f"tf ({top} to {self.sensor_frame}{lack})"

    def extend(
        self,
        stamps: ArrayLike,
        parent: str,
        child: str,
        rotation: ArrayLike,
        translation: ArrayLike,
        *,
        fixed: bool = False,
    ) -> bool:
        """Add transforms, x_parent = rotation @ x_child + translation; what is no rigid motion is counted and left out.

        Args:
            stamps: (N,) int64 ns.
            parent, child: frames.
            rotation: (N, 3, 3).
            translation: (N, 3) m.
            fixed: they come from tf_static; the last one holds for all times.

        Returns:
            Whether any of them is used.

        Raises:
            InputError: FRAME_UNKNOWN when a frame changes its parent.
        """
        if self._parents.setdefault(child, parent) != parent:
            raise InputError(
                ErrorCode.FRAME_UNKNOWN,
                f"tf: frame {child} hangs on {self._parents[child]} and now on {parent}: only one of them may publish",
            )
        times, turns = np.asarray(stamps, dtype=np.int64), np.asarray(rotation, dtype=np.float64)
        rows = np.hstack([turns.reshape(-1, 9), np.asarray(translation, dtype=np.float64).reshape(-1, 3)])
        unit = np.abs(turns @ turns.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2)) < 1e-3  # false for NaN
        good = unit & np.isfinite(rows).all(axis=1)
        self.not_finite += int(np.count_nonzero(~good))
        if not good.any():
            return False
        self._has_positions |= bool(np.any(rows[good, 9:] != 0))
        if fixed:
            self._fixed[child] = rows[good][-1]
            return True
        buffer = self._moving.setdefault(child, StampedBuffer(12))
        if went_back(times[good], buffer.newest):
            self.jumps += 1
            self.clear()
        buffer.extend(times[good], rows[good])
        return True

    @property
    def known_frames(self) -> tuple[str, ...]:
        """Every child that was told of."""
        return tuple(self._parents)

    @property
    def newest(self) -> int | None:
        ends = [self._moving[child].newest for child in self._chain() if child in self._moving]
        known = [end for end in ends if end is not None]
        return min(known) if known and len(known) == len(ends) else None

    def stamps(self, begin: int, end: int) -> Stamps:
        # Those of the moving transform next to the sensor.
        moving = [self._moving[child] for child in self._chain() if child in self._moving]
        return moving[-1].between(begin, end)[0] if moving else np.zeros(0, dtype=np.int64)

    def poses(self, begin: int, end: int) -> Poses:
        stamps = self.stamps(begin, end)
        rotation, translation = np.tile(np.eye(3), (len(stamps), 1, 1)), np.zeros((len(stamps), 3))
        valid = np.ones(len(stamps), dtype=bool)
        for child in self._chain():
            if child in self._moving:
                known, rows = self._moving[child].stamps, self._moving[child].rows
                turns = interpolate_rotations(known, rows[:, :9], stamps, max_gap=self.max_gap)
                turn, valid = turns.values, valid & turns.found
                shift = interpolate(known, rows[:, 9:], stamps, max_gap=self.max_gap).values
            else:
                turn, shift = self._fixed[child][:9].reshape(3, 3), self._fixed[child][9:]
            translation = translation + np.einsum("nij,nj->ni", rotation, np.broadcast_to(shift, translation.shape))
            rotation = rotation @ turn
        return Poses(stamps[valid], rotation[valid], translation[valid])

    @property
    def has_positions(self) -> bool:
        """Some transform has a translation; without any only attitudes were recorded."""
        return self._has_positions

    def motion(self, begin: int, end: int, margin: int = 0) -> SensorMotion:
        return self.measured(begin, end, margin).motion

    def measured(self, begin: int, end: int, margin: int = 0) -> MeasuredMotion:
        """The motion with its uncertainty."""
        poses = self.poses(begin - margin, end + margin)
        return motion_from_poses(poses.stamps, poses.rotation, poses.translation, within=(begin, end))

    def forget_before(self, stamp: int) -> None:
        for buffer in self._moving.values():
            buffer.forget_before(stamp)

    def keep_last(self, seconds: float) -> None:
        """Of each transform, drop what is older than its newest by more."""
        for buffer in self._moving.values():
            if buffer.newest is not None:
                buffer.forget_before(buffer.newest - round(seconds * 1e9))

    def clear(self) -> None:
        for buffer in self._moving.values():
            buffer.clear()

    def _chain(self) -> list[str]:
        """Children from the base down to the sensor; empty while they do not connect."""
        chain: list[str] = []
        frame = self.sensor_frame
        while frame != self.base_frame and frame in self._parents and frame not in chain:
            chain.append(frame)
            frame = self._parents[frame]
        return chain[::-1] if self.base_frame in (None, frame) else []
