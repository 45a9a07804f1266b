"""From tf messages to a tree of frames, and messages into other frames of that tree."""

import math
from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from tf2_msgs.msg import TFMessage

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.nodes.runtime import TF_STATIC, guarded
from poise.recording import stamp_of
from poise.robot import FrameTree

_UNIT = 5e-3
"""By how much the length of a quaternion may be off 1."""


def heard_frames(node: Node, depth: int = 100) -> FrameTree:
    """The newest transforms of tf and tf_static, as a node hears them; depth: messages of tf that may wait."""
    frames = FrameTree(one_parent=False, keep=False)
    take = partial(add_transforms, frames)
    node.create_subscription(TFMessage, "tf", guarded(node, take), depth)
    node.create_subscription(TFMessage, "tf_static", guarded(node, partial(take, fixed=True)), TF_STATIC)
    return frames


def add_transforms(tree: FrameTree, message: TFMessage, fixed: bool = False) -> None:
    """Add the transforms of a message; one that is not finite, or without a unit quaternion, is left out.

    Args:
        tree: takes them.
        message: from tf or tf_static.
        fixed: it comes from tf_static.

    Raises:
        InputError: NOT_FINITE, naming the last frame left out; FRAME_UNKNOWN as `FrameTree.add`.
    """
    wrong, good, values = None, [], []
    for stamped in message.transforms:
        shift, turn = stamped.transform.translation, stamped.transform.rotation
        length = math.hypot(turn.x, turn.y, turn.z, turn.w)  # squares of huge numbers would overflow
        if not (abs(length - 1) < _UNIT and abs(shift.x + shift.y + shift.z) < float("inf")):
            wrong = stamped.child_frame_id
            continue
        good.append(stamped)
        values.append([shift.x, shift.y, shift.z, turn.x, turn.y, turn.z, turn.w])
    poses = Pose.from_vector(np.reshape(values, (-1, 7)))  # all at once: this runs for each message of tf
    for stamped, rotation, place in zip(good, poses.rotation, poses.translation, strict=True):
        frames = stamped.header.frame_id, stamped.child_frame_id
        tree.add([stamp_of(stamped)], *frames, rotation[None], place[None], fixed=fixed)
    if wrong is not None:
        raise InputError(ErrorCode.NOT_FINITE, f"tf: the transform of {wrong} is not valid; it was left out")


def pose_between(frames: FrameTree, frame: str, reference: str) -> Pose:
    """The newest pose of a frame in another one.

    Raises:
        InputError: FRAME_UNKNOWN when tf does not connect them.
    """
    pose = Pose.identity() if frame == reference else frames.pose(frame, reference)
    if pose is None:
        raise InputError(
            ErrorCode.FRAME_UNKNOWN,
            f"tf does not connect {frame} with {reference}, the frame of the assembly: publish the missing transform, "
            f"or send the poses in {reference}",
        )
    return pose


def transform_objects(items: Iterable[Any], pose_reference_frame: Pose) -> None:
    """Change the poses of objects (poise_msgs/AssemblyObject) in place: from a frame into the reference."""
    turn = np.kron(np.eye(2), pose_reference_frame.rotation)
    for item in items:
        if len(item.pose_covariance):  # both blocks are in the axes of the frame
            item.pose_covariance = (turn @ np.reshape(item.pose_covariance, (6, 6)) @ turn.T).ravel().tolist()
        set_pose(item.pose, pose_reference_frame @ pose_of(item.pose, f"object {item.id}: "))


def transform_pushes(pushes: Iterable[Any], pose_reference_frame: Pose) -> None:
    """Change points and directions of pushes in place: from a frame into the reference."""
    for push in pushes:
        point, direction = push.point, push.direction
        place = pose_reference_frame.apply(np.array([point.x, point.y, point.z]))
        point.x, point.y, point.z = place.tolist()
        turned = pose_reference_frame.rotation @ [direction.x, direction.y, direction.z]
        direction.x, direction.y, direction.z = turned.tolist()


def pose_of(message: Any, where: str = "") -> Pose:
    """The pose in a geometry_msgs/Pose; where: what has it, for the message of an error.

    Raises:
        InputError: NOT_FINITE; BAD_INPUT without a unit quaternion.
    """
    place, turn = message.position, message.orientation
    values = [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]
    length = math.hypot(*values[3:])
    if not all(map(math.isfinite, values)):
        raise InputError(ErrorCode.NOT_FINITE, f"{where}pose {values} has an entry that is not finite")
    if abs(length - 1) > _UNIT:
        what = f"{where}the quaternion of the pose (x y z w) has length {length:.4g}, expected 1"
        raise InputError(ErrorCode.BAD_INPUT, what)
    return Pose.from_vector(values)


def pose_of_transform(message: Any) -> Pose:
    """The pose in a geometry_msgs/Transform."""
    shift, turn = message.translation, message.rotation
    return Pose.from_vector([shift.x, shift.y, shift.z, turn.x, turn.y, turn.z, turn.w])


def set_pose(message: Any, pose: Pose) -> None:
    """Write a pose into a geometry_msgs/Pose."""
    place, turn = message.position, message.orientation
    place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = pose.vector.tolist()


def moved_poses(assembly: Any, frames: FrameTree, tolerance: float) -> dict[str, list[float]] | None:
    """x y z qx qy qz qw of movable objects that tf has elsewhere than a poise_msgs/Assembly, by id.

    Args:
        assembly: the message; its frame is the reference.
        frames: frames with the ids of objects are theirs.
        tolerance: m and rad; smaller motions are left out.

    Returns:
        None when tf has no frame of an object.
    """
    reference, known = assembly.header.frame_id, False
    moved = {}
    for item in assembly.objects:
        pose = None if item.fixed else frames.pose(item.id, reference)
        if pose is None:
            continue
        known = True
        if _apart(pose_of(item.pose), pose) > tolerance:
            moved[item.id] = pose.vector.tolist()
    return moved if known else None


def _apart(first: Pose, second: Pose) -> float:
    """How far two poses are from each other, m or rad, whichever is more."""
    turn = first.rotation.T @ second.rotation
    angle = float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0)))
    return max(float(np.linalg.norm(first.translation - second.translation)), angle)
