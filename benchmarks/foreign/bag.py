"""The recording as a file: one mcap by rosbags, which shares nothing with the tool's own reader."""

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from benchmarks.foreign.robots import Array

Entry = tuple[int, str, str, Any]
"""Stamp in ns, topic, type and message."""
_TYPES = get_typestore(Stores.ROS2_JAZZY)


@dataclass(frozen=True, eq=False)
class Joints:
    """joint_states or joint_commands: stamps (n,) ns; (n, J) each, or (n, 0) where a driver gives none."""

    stamps: NDArray[np.int64]
    position: Array
    velocity: Array
    effort: Array


@dataclass(frozen=True, eq=False)
class Wrenches:
    """wrench: stamps (n,) ns, values (n, 6)."""

    stamps: NDArray[np.int64]
    values: Array


@dataclass(frozen=True, eq=False)
class Odometry:
    """odom: stamps (n,) ns, pose (n, 3) x, y, yaw, twist (n, 3) in base axes."""

    stamps: NDArray[np.int64]
    pose: Array
    twist: Array
    deviation: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Streams:
    """All that a rig has recorded."""

    robot_description: str
    joints: Joints
    names: Sequence[str]
    frame: str
    wrench: Wrenches | None = None
    odom: Odometry | None = None
    commands: Joints | None = None


def write(streams: Streams, path: Path) -> None:
    """Write NAME.mcap; the bytes depend on the content alone."""
    save(messages(streams), path)


def save(entries: Sequence[Entry], path: Path) -> None:
    """Write messages in the order of time, then of topics."""
    ordered = sorted(entries, key=lambda entry: (entry[0], entry[1]))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "bag"
        with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            kinds = {topic: kind for _, topic, kind, _ in ordered}
            channels = {
                topic: writer.add_connection(f"/{topic}", kinds[topic], typestore=_TYPES) for topic in sorted(kinds)
            }
            for stamp, topic, kind, message in ordered:
                writer.write(channels[topic], stamp, bytes(_TYPES.serialize_cdr(message, kind)))
        shutil.move(next(folder.glob("*.mcap")), path)


def messages(streams: Streams) -> list[Entry]:
    """All messages of a rig."""
    first = int(streams.joints.stamps[0])
    text = make("std_msgs/msg/String", data=streams.robot_description)
    found: list[Entry] = [(first, "robot_description", "std_msgs/msg/String", text)]
    for topic, joints in (("joint_states", streams.joints), ("joint_commands", streams.commands)):
        if joints is not None:
            kind = "sensor_msgs/msg/JointState"
            for i, stamp in enumerate(joints.stamps):
                values = (joints.position, joints.velocity, joints.effort)
                rows = dict(zip(("position", "velocity", "effort"), (np.array(v[i]) for v in values), strict=True))
                message = make(kind, header=header(stamp, ""), name=list(streams.names), **rows)
                found.append((int(stamp), topic, kind, message))
    if streams.wrench is not None:
        found += wrench_messages(streams.wrench, streams.frame)
    return found + (_odometry(streams.odom) if streams.odom is not None else [])


def wrench_messages(wrenches: Wrenches, frame: str) -> list[Entry]:
    """One message for each wrench."""
    kind, found = "geometry_msgs/msg/WrenchStamped", []
    for stamp, value in zip(wrenches.stamps, wrenches.values, strict=True):
        wrench = make("geometry_msgs/msg/Wrench", force=vector(value[:3]), torque=vector(value[3:]))
        found.append((int(stamp), "wrench", kind, make(kind, header=header(stamp, frame), wrench=wrench)))
    return found


def _odometry(odom: Odometry) -> list[Entry]:
    kind, found = "nav_msgs/msg/Odometry", []
    place, speed = (np.diag([d**2, d**2, 1e-9, 1e-9, 1e-9, d**2]).ravel() for d in odom.deviation)
    for stamp, (x, y, yaw), (vx, vy, turn) in zip(odom.stamps, odom.pose, odom.twist, strict=True):
        half = yaw / 2
        quaternion = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half)))
        position = make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0)
        pose = make("geometry_msgs/msg/Pose", position=position, orientation=quaternion)
        twist = make("geometry_msgs/msg/Twist", linear=vector([vx, vy, 0.0]), angular=vector([0.0, 0.0, turn]))
        message = make(
            kind,
            header=header(stamp, "odom"),
            child_frame_id="base_link",
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=place),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=speed),
        )
        found.append((int(stamp), "odom", kind, message))
    return found


def header(stamp: int, frame: str) -> Any:
    """A stamp in ns and a frame."""
    time = make("builtin_interfaces/msg/Time", sec=int(stamp // 10**9), nanosec=int(stamp % 10**9))
    return make("std_msgs/msg/Header", stamp=time, frame_id=frame)


def vector(values: Any) -> Any:
    """geometry_msgs/Vector3 of three numbers."""
    return make("geometry_msgs/msg/Vector3", **{axis: float(v) for axis, v in zip("xyz", values, strict=True)})


def make(kind: str, **fields: Any) -> Any:
    """A message of a type."""
    return _TYPES.types[kind](**fields)
