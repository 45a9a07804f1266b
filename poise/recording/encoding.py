"""From streams to messages: what each topic of the contract carries, in CDR, with its definition."""

import functools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import scipy
import yaml
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.base import TypesysError
from rosbags.typesys.store import Typestore

from poise.errors import ErrorCode, InputError
from poise.recording.streams import ImuStream, JointStream, PoseStream, Stream, WrenchStream
from poise.types import Array

LATCHED_TOPICS = ("tf_static", "robot_description")  # late subscribers get the last message
Encoded = tuple[int, bytes]  # stamp ns, CDR


@functools.cache
def typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def definition_of(message_type: str) -> tuple[str, str]:
    """Return a type's definition (ros2msg) and its type hash (REP-2016).

    Raises:
        InputError: UNSUPPORTED when the type is not one of ROS 2 Jazzy's common ones.
    """
    try:
        text, _ = typestore().generate_msgdef(message_type, ros_version=2)
        return text, typestore().hash_rihs01(message_type)
    except TypesysError as error:
        sentence = f"the definition of {message_type} is not known here: give it with the topic"
        raise InputError(ErrorCode.UNSUPPORTED, sentence) from error


def qos_profile(topic: str) -> str:
    """Return the QoS that rosbag2 plays a topic with, in the YAML of its metadata version 9."""
    forever = {"sec": 9223372036, "nsec": 854775807}
    latched = topic.rpartition("/")[2] in LATCHED_TOPICS
    profile = {
        "history": "keep_last",
        "depth": 1 if latched else 10,
        "reliability": "reliable",
        "durability": "transient_local" if latched else "volatile",
        "deadline": forever,
        "lifespan": forever,
        "liveliness": "automatic",
        "liveliness_lease_duration": forever,
        "avoid_ros_namespace_conventions": False,
    }
    return str(yaml.safe_dump([profile], sort_keys=False))


def message_type_of(topic: str, stream: Stream) -> str:
    """Return the message type that carries a stream on a topic; poses go to odometry on `odom`, else to tf."""
    if isinstance(stream, WrenchStream):
        return "geometry_msgs/msg/WrenchStamped"
    if isinstance(stream, JointStream):
        return "sensor_msgs/msg/JointState"
    if isinstance(stream, ImuStream):
        return "sensor_msgs/msg/Imu"
    if isinstance(stream, PoseStream):
        return "nav_msgs/msg/Odometry" if topic.rpartition("/")[2] == "odom" else "tf2_msgs/msg/TFMessage"
    raise InputError(ErrorCode.TYPE_MISMATCH, f"topic {topic}: {type(stream).__name__} is not a stream")


def encode_stream(topic: str, stream: Stream) -> Iterator[Encoded]:
    """Encode each sample of a stream as the message of its topic."""
    message_type = message_type_of(topic, stream)
    encoders: dict[type[Stream], Callable[[Any], Iterator[Any]]] = {
        WrenchStream: _wrench_messages,
        JointStream: _joint_messages,
        ImuStream: _imu_messages,
        PoseStream: _odometry_messages if message_type.startswith("nav_msgs") else _tf_messages,
    }
    for stamp, message in zip(stream.stamps.tolist(), encoders[type(stream)](stream), strict=True):
        yield stamp, bytes(typestore().serialize_cdr(message, message_type))


def encode_text(text: str) -> bytes:
    """Encode a std_msgs/String."""
    return bytes(typestore().serialize_cdr(_make("std_msgs/msg/String", data=text), "std_msgs/msg/String"))


def _make(message_type: str, **fields: Any) -> Any:
    make: Any = typestore().types[message_type]
    return make(**fields)


def _header(stamp: int, frame_id: str) -> Any:
    sec, nanosec = divmod(stamp, 1_000_000_000)
    time = _make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return _make("std_msgs/msg/Header", stamp=time, frame_id=frame_id)


def _vector(values: list[float]) -> Any:
    return _make("geometry_msgs/msg/Vector3", x=values[0], y=values[1], z=values[2])


def _quaternion(values: list[float]) -> Any:
    return _make("geometry_msgs/msg/Quaternion", x=values[0], y=values[1], z=values[2], w=values[3])


def _wrench_messages(stream: WrenchStream) -> Iterator[Any]:
    for stamp, row in zip(stream.stamps.tolist(), stream.wrench_in_sensor.tolist(), strict=True):
        wrench = _make("geometry_msgs/msg/Wrench", force=_vector(row[:3]), torque=_vector(row[3:]))
        yield _make("geometry_msgs/msg/WrenchStamped", header=_header(stamp, stream.frame_id), wrench=wrench)


def _joint_messages(stream: JointStream) -> Iterator[Any]:
    names = list(stream.names)
    for row, stamp in enumerate(stream.stamps.tolist()):
        yield _make(
            "sensor_msgs/msg/JointState",
            header=_header(stamp, ""),
            name=names,
            position=_or_nothing(stream.position, row),
            velocity=_or_nothing(stream.velocity, row),
            effort=_or_nothing(stream.effort, row),
        )


def _or_nothing(values: Array, row: int) -> Array:
    """Leave a field out of the message when all of the row is NaN."""
    chosen: Array = values[row][:0] if np.isnan(values[row]).all() else values[row]
    return chosen


def _imu_messages(stream: ImuStream) -> Iterator[Any]:
    """What is NaN is declared as not measured, by the covariance of -1 that sensor_msgs/Imu asks for."""
    unknown, absent = np.zeros(9), np.array([-1.0, 0, 0, 0, 0, 0, 0, 0, 0])
    for row, stamp in enumerate(stream.stamps.tolist()):
        turning, acceleration = stream.angular_velocity[row], stream.linear_acceleration[row]
        turns, accelerates = not np.isnan(turning).all(), not np.isnan(acceleration).all()
        yield _make(
            "sensor_msgs/msg/Imu",
            header=_header(stamp, stream.frame_id),
            orientation=_quaternion([0.0, 0.0, 0.0, 1.0]),
            orientation_covariance=absent,
            angular_velocity=_vector(turning.tolist() if turns else [0.0] * 3),
            angular_velocity_covariance=unknown if turns else absent,
            linear_acceleration=_vector(acceleration.tolist() if accelerates else [0.0] * 3),
            linear_acceleration_covariance=unknown if accelerates else absent,
        )


def quaternions_of(stream: PoseStream) -> list[list[float]]:
    """Return quaternions x y z w with w >= 0; zero for a rotation that is NaN, which reads back as NaN."""
    quaternions = np.zeros((len(stream), 4))
    known = np.isfinite(stream.rotation_parent_child).all(axis=(1, 2))
    if known.any():
        quaternions[known] = scipy.spatial.transform.Rotation.from_matrix(stream.rotation_parent_child[known]).as_quat(
            canonical=True
        )
    rows: list[list[float]] = quaternions.tolist()
    return rows


def _tf_messages(stream: PoseStream) -> Iterator[Any]:
    rows = zip(stream.stamps.tolist(), stream.translation_parent_child.tolist(), quaternions_of(stream), strict=True)
    for stamp, translation, quaternion in rows:
        transform = _make(
            "geometry_msgs/msg/Transform", translation=_vector(translation), rotation=_quaternion(quaternion)
        )
        stamped = _make(
            "geometry_msgs/msg/TransformStamped",
            header=_header(stamp, stream.parent),
            child_frame_id=stream.child,
            transform=transform,
        )
        yield _make("tf2_msgs/msg/TFMessage", transforms=[stamped])


def _odometry_messages(stream: PoseStream) -> Iterator[Any]:
    """A twist that was not measured is NaN."""
    unknown = np.zeros(36)
    twists = np.full((len(stream), 6), np.nan) if stream.twist_in_child is None else stream.twist_in_child
    poses = zip(stream.translation_parent_child.tolist(), quaternions_of(stream), twists.tolist(), strict=True)
    for stamp, (translation, quaternion, rates) in zip(stream.stamps.tolist(), poses, strict=True):
        twist = _make("geometry_msgs/msg/Twist", linear=_vector(rates[:3]), angular=_vector(rates[3:]))
        point = _make("geometry_msgs/msg/Point", x=translation[0], y=translation[1], z=translation[2])
        pose = _make("geometry_msgs/msg/Pose", position=point, orientation=_quaternion(quaternion))
        yield _make(
            "nav_msgs/msg/Odometry",
            header=_header(stamp, stream.parent),
            child_frame_id=stream.child,
            pose=_make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
            twist=_make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
        )
