"""The frames of a robot's links, as robot_state_publisher publishes them, and messages of tf and odom."""

import functools
from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio as pin

from poise.fake_robots.drive import BASE_JOINTS
from poise.geometry import Pose
from poise.recording import typestore
from poise.robot import RobotModel, parse_urdf, pinocchio_state
from poise.types import Array


class LinkFrames:
    """The links of a description, each in its parent; joints that joint states do not contain are at rest.

    Args:
        description: a URDF.
        model: of it, whose joints move.
        more: fixed frames beside the URDF's: parent, child and pose.
    """

    def __init__(self, description: str, model: RobotModel, more: Iterable[tuple[str, str, Pose]] = ()) -> None:
        tree = parse_urdf(description)
        self._model = model
        self._data = model.pinocchio.createData()
        frames, index = model.pinocchio.frames, {link: model.frame_id(link) for link in tree.links}
        joint = {link: frames[number].parentJoint for link, number in index.items()}
        pairs = [(parent, child, index[parent], index[child]) for child, parent in tree.parent_of.items()]
        self._moving = [pair for pair in pairs if joint[pair[0]] != joint[pair[1]]]
        self._fixed = [
            (parent, child, _pose(frames[i].placement.actInv(frames[j].placement)))
            for parent, child, i, j in pairs
            if joint[parent] == joint[child]
        ]
        self._fixed += list(more)
        columns = [model.joint_names.index(name) for name in BASE_JOINTS if name in model.joint_names]
        self.base_columns = columns if len(columns) == len(BASE_JOINTS) else []
        """Of the base's joints among the model's; empty: it does not drive."""
        self.root = tree.root
        self.base = self.root
        """The link that stands on the floor."""
        if self.base_columns:
            turning = model.pinocchio.getJointId(BASE_JOINTS[2])
            self.base = next(child for _, child, _, _ in self._moving if joint[child] == turning)

    def fixed(self, stamp: int) -> bytes:
        """CDR of the message on tf_static."""
        return tf_bytes([(stamp, *each) for each in self._fixed])

    def moving(self, stamp: int, position: Array) -> bytes:
        """CDR of the message on tf, for (J,) joint positions."""
        places = self._places(position)
        moved = [(parent, child, _pose(places[i].actInv(places[j]))) for parent, child, i, j in self._moving]
        return tf_bytes([(stamp, *each) for each in moved])

    def poses(self, frames: Iterable[str], position: Array) -> list[Pose]:
        """Of frames in the root, for (J,) joint positions."""
        places = self._places(position)
        return [_pose(places[self._model.frame_id(frame)]) for frame in frames]

    def _places(self, position: Array) -> Any:
        still = np.zeros((1, len(position)))
        motion = pinocchio_state(self._model, position[None], still, still)
        pin.framesForwardKinematics(self._model.pinocchio, self._data, motion.q[0])
        return self._data.oMf


def _pose(placement: "pin.SE3") -> Pose:
    return Pose(np.array(placement.rotation), np.array(placement.translation))


def tf_bytes(frames: Iterable[tuple[int, str, str, Pose]]) -> bytes:
    """CDR of tf2_msgs/TFMessage, of stamps ns, parents, children and poses."""
    make, frames = _types(), list(frames)
    rotation, place = (np.array([getattr(each[3], part) for each in frames]) for part in ("rotation", "translation"))
    vectors = Pose(rotation, place).vector.tolist() if frames else []
    stamped = []
    for (stamp, parent, child, _), (x, y, z, qx, qy, qz, qw) in zip(frames, vectors, strict=True):
        transform = make["geometry_msgs/msg/Transform"](
            make["geometry_msgs/msg/Vector3"](x, y, z), make["geometry_msgs/msg/Quaternion"](qx, qy, qz, qw)
        )
        stamped.append(make["geometry_msgs/msg/TransformStamped"](_header(stamp, parent), child, transform))
    return bytes(typestore().serialize_cdr(make["tf2_msgs/msg/TFMessage"](stamped), "tf2_msgs/msg/TFMessage"))


def odometry_bytes(stamp: int, frame: str, child: str, pose: Array, velocity: Array) -> bytes:
    """CDR of nav_msgs/Odometry: x, y, yaw in a frame, and the twist in the child as REP-105 wants it."""
    make = _types()
    x, y, yaw = (float(value) for value in pose)
    cosine, sine = np.cos(yaw), np.sin(yaw)
    forward = float(cosine * velocity[0] + sine * velocity[1])
    left = float(-sine * velocity[0] + cosine * velocity[1])

    def vector(kind: str, *values: float) -> Any:
        return make[f"geometry_msgs/msg/{kind}"](*values)

    turned = vector("Quaternion", 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
    where = make["geometry_msgs/msg/Pose"](vector("Point", x, y, 0.0), turned)
    twist = make["geometry_msgs/msg/Twist"](
        vector("Vector3", forward, left, 0.0), vector("Vector3", 0.0, 0.0, float(velocity[2]))
    )
    exact = np.zeros(36)
    message = make["nav_msgs/msg/Odometry"](
        _header(stamp, frame),
        child,
        make["geometry_msgs/msg/PoseWithCovariance"](where, exact),
        make["geometry_msgs/msg/TwistWithCovariance"](twist, exact),
    )
    return bytes(typestore().serialize_cdr(message, "nav_msgs/msg/Odometry"))


@functools.cache
def _types() -> dict[str, Any]:
    return dict(typestore().types)


def _header(stamp: int, frame: str) -> Any:
    make = _types()
    seconds, nanoseconds = divmod(int(stamp), 10**9)
    return make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](seconds, nanoseconds), frame)
