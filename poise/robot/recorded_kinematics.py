"""The kinematics of a recording: joint states through a robot model, or a chain of tf frames."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.recording import JointStream, PoseStream, Recording
from poise.robot.model import RobotModel, chains
from poise.robot.odometry_input import usable_odometry
from poise.robot.recorded_frames import frames_above, is_constant
from poise.robot.sources import FrameSource, JointSource, MotionSource
from poise.types import Stamps


@dataclass
class Kinematics:
    """The kinematics of a recording, to be fed to a source in the order of time.

    Args:
        source: takes them.
        parts: stamps (N,) and what adds the samples of a slice to the source.
        has_positions: False when only attitudes were recorded.
    """

    source: MotionSource
    parts: list[tuple[Stamps, Callable[[slice], None]]]
    has_positions: bool = True

    def feed(self, begin: int | None, end: int | None) -> None:
        """Add what is stamped after `begin` and no later than `end`; None: no limit."""
        for stamps, add in self.parts:
            low = 0 if begin is None else int(np.searchsorted(stamps, begin, "right"))
            high = len(stamps) if end is None else int(np.searchsorted(stamps, end, "right"))
            if high > low:
                add(slice(low, high))


def find_kinematics(
    recording: Recording, sensor_frame: str, robot_model: RobotModel | None = None, base_frame: str | None = None
) -> Kinematics:
    """Joint states with a robot model where there are both, else tf.

    Raises:
        InputError: when the recording has neither, or the sensor frame is in neither.
    """
    joints, frames = has_topic(recording, "joint_states"), has_topic(recording, "tf")
    odometry = recording.odometry() if joints and has_topic(recording, "odom") else None
    if odometry is not None and not is_constant(odometry):
        odometry = usable_odometry(odometry)[0]
    if odometry is not None and is_constant(odometry):
        odometry = None
    if robot_model is None and joints and has_topic(recording, "robot_description"):
        try:
            text = recording.robot_description()
            streams = robot_of(text, sensor_frame, lambda names: recording.joint_states(names=names), odometry)
            return _joint_kinematics(*streams)
        except InputError as error:
            if error.code is not ErrorCode.FRAME_UNKNOWN or not frames:
                raise InputError(error.code, f"{recording.path}: {error.message}", **error.data) from error
    if robot_model is not None:
        return _joint_kinematics(recording.joint_states(names=robot_model.joint_names), robot_model, None)
    if frames:
        return _frame_kinematics(recording, sensor_frame, base_frame)
    if joints:
        raise InputError(
            ErrorCode.ROBOT_DESCRIPTION_MISSING,
            f"{recording.path} has joint_states, but no robot_description: give a URDF file, or record it too",
        )
    raise InputError(
        ErrorCode.TOPIC_MISSING,
        f"{recording.path} does not say how {sensor_frame} moved: record joint_states with robot_description,"
        f" or tf up to {sensor_frame}",
    )


def has_topic(recording: Recording, topic: str) -> bool:
    """The recording holds messages of that name."""
    try:
        recording.topic(topic)
    except InputError as error:
        if error.code is ErrorCode.TOPIC_MISSING:
            return False
        raise
    return True


def robot_of(
    text: str,
    sensor_frame: str | None,
    joint_states: Callable[[tuple[str, ...]], JointStream],
    odometry: PoseStream | None,
    held: Mapping[str, float] | None = None,
) -> tuple[JointStream, RobotModel, PoseStream | None]:
    """The robot of a URDF, with the joint states that move it, and odometry where that moves its root link.

    Odometry is not needed when the joint states contain the joints of a mobile base. When they lack the first joints
    of the robot, a base or a rail, odometry contains their motion.

    Args:
        text: the URDF.
        sensor_frame: a link; None: the last link of the longest chain whose joints have states.
        joint_states: reads the states of these joints.
        odometry: of the root link; None: it does not move.
        held: joints without states, and where they stand, rad or m.

    Raises:
        InputError: JOINT_MISSING, or as `RobotModel.from_urdf`.
    """
    stated = dict(held or {})
    found: dict[tuple[str, ...], JointStream] = {}

    def has_joints(names: tuple[str, ...]) -> bool:
        try:
            found[names] = joint_states(names)
        except InputError as error:
            if error.code is not ErrorCode.JOINT_MISSING:
                raise
        return names in found

    if sensor_frame is None:
        every = [(link, tuple(name for name in names if name not in stated)) for link, names in chains(text)]
        sensor_frame = next((link for link, names in every if names and has_joints(names)), every[0][0])
    robot = RobotModel.from_urdf(text, sensor_frame, locked=stated)
    if odometry is not None:
        robot = robot_on_odometry(robot, text, has_joints, stated)
    joints = found.get(robot.joint_names) or joint_states(robot.joint_names)
    return joints, robot, odometry if robot.base == "floating" else None


def robot_on_odometry(
    robot: RobotModel,
    text: str,
    has_joints: Callable[[tuple[str, ...]], bool],
    held: Mapping[str, float] | None = None,
) -> RobotModel:
    """The same robot with a floating base, where odometry has to move it; see `robot_of`.

    Args:
        robot: with a fixed base.
        text: its URDF.
        has_joints: whether the joint states contain all of these joints.
        held: joints without states, and where they stand, rad or m.
    """
    stated = dict(held or {})
    if has_joints(robot.joint_names):
        if robot.base_joints:
            return robot
        return RobotModel.from_urdf(text, robot.sensor_frame, base="floating", locked=stated)
    leading = robot.base_joints or int(robot.slides_first)
    if not leading or not has_joints(robot.joint_names[leading:]):
        return robot
    locked = stated | dict.fromkeys(robot.joint_names[:leading], 0.0)
    return RobotModel.from_urdf(text, robot.sensor_frame, base="floating", locked=locked)


def _joint_kinematics(stream: JointStream, model: RobotModel, odometry: PoseStream | None) -> Kinematics:
    source = JointSource(model)

    def add(part: slice) -> None:
        source.extend(stream.stamps[part], stream.names, stream.position[part], stream.velocity[part])

    parts: list[tuple[Stamps, Callable[[slice], None]]] = [(stream.stamps, add)]
    if odometry is not None:
        poses = odometry

        def add_odometry(part: slice) -> None:
            rotation, translation = poses.rotation_parent_child[part], poses.translation_parent_child[part]
            source.add_odometry(poses.stamps[part], rotation, translation)

        parts.append((poses.stamps, add_odometry))
    return Kinematics(source, parts)


def _frame_kinematics(recording: Recording, sensor_frame: str, base_frame: str | None) -> Kinematics:
    """Every transform from the sensor up to the base."""
    source = FrameSource(sensor_frame, base_frame)
    streams = frames_above(recording, sensor_frame, base_frame, strict=True)
    still = [is_constant(stream) for stream in streams]
    if all(still):  # nothing moves: keep the samples of the first transform, for their stamps
        still[0] = False
    parts: list[tuple[Stamps, Callable[[slice], None]]] = []
    for stream, fixed in zip(streams, still, strict=True):
        add = _adder(source, stream, fixed)
        if fixed:
            add(slice(None))
        else:
            parts.append((stream.stamps, add))
    return Kinematics(source, parts, any(np.any(stream.translation_parent_child) for stream in streams))


def _adder(source: FrameSource, stream: PoseStream, fixed: bool) -> Callable[[slice], None]:
    def add(part: slice) -> None:
        source.extend(
            stream.stamps[part],
            stream.parent,
            stream.child,
            stream.rotation_parent_child[part],
            stream.translation_parent_child[part],
            fixed=fixed,
        )

    return add
