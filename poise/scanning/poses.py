"""Where the camera was: joint states and a robot description give the hand, a hand-eye transform gives the camera."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.geometry import quaternion_of_rotation, rotation_of_quaternion
from poise.recording import JointStream, Reason, interpolate
from poise.robot import RobotModel, frame_poses, parse_urdf
from poise.types import Array, Mask

GAP, WIDE_GAP = 0.1, 3.0
"""s between joint states across which a pose is trusted, and across which it is guessed."""


@dataclass(frozen=True, eq=False)
class Transform:
    """Where a child frame is in its parent: x_parent = rotation x_child + translation."""

    parent: str
    child: str
    rotation: Array
    translation: Array

    @classmethod
    def from_pose(cls, parent: str, child: str, pose: ArrayLike) -> "Transform":
        """From x y z (m) and a quaternion x y z w.

        Raises:
            InputError: BAD_INPUT when that is no pose.
        """
        values = np.asarray(pose, dtype=np.float64)
        if values.shape != (7,) or not np.isfinite(values).all() or abs(np.linalg.norm(values[3:]) - 1) > 1e-2:
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"transform {parent} -> {child}: {values.tolist()} is no pose; give x y z in m and a unit quaternion"
                " x y z w",
            )
        return cls(parent, child, rotation_of_quaternion(values[3:]), values[:3])


@dataclass(frozen=True, eq=False)
class Poses:
    """Where a camera was at V stamps, in the robot's base.

    Args:
        rotation: (V, 3, 3), world <- camera.
        translation: (V, 3) m.
        sure: (V,) False where joint states were too far apart and the pose is interpolated.
        known: (V,) False where nothing is known; the pose is then NaN.
    """

    rotation: Array
    translation: Array
    sure: Mask
    known: Mask


def hand_eye_of(description: str, camera_frame: str, fixed: Sequence[Transform]) -> Transform:
    """The camera's frame in the link of the robot that carries it.

    Args:
        description: URDF.
        camera_frame: of the images.
        fixed: what tf_static tells, and what was given by hand; later ones win.

    Raises:
        InputError: ROBOT_DESCRIPTION_INVALID; FRAME_UNKNOWN when nothing connects the camera to the robot.
    """
    links = parse_urdf(description).links
    above = {transform.child: transform for transform in fixed}
    frame, rotation, translation = camera_frame, np.eye(3), np.zeros(3)
    for _ in range(len(above) + 1):
        if frame in links:
            return Transform(frame, camera_frame, rotation, translation)
        if frame not in above:
            break
        step = above[frame]
        rotation, translation = step.rotation @ rotation, step.rotation @ translation + step.translation
        frame = step.parent
    raise InputError(
        ErrorCode.FRAME_UNKNOWN,
        f"no hand-eye transform: neither robot_description nor tf_static connects the camera frame {camera_frame!r} to"
        " a link of the robot; record tf_static, or give the link and x y z qx qy qz qw of the camera's optical frame"
        " in it (hand_eye)",
    )


def camera_poses(
    model: RobotModel, joints: JointStream, hand_eye: Transform, stamps: NDArray[np.int64], delay: float = 0.0
) -> Poses:
    """Poses at the stamps of images.

    Args:
        model: the robot as far as the link that carries the camera.
        joints: joint states.
        hand_eye: of the camera.
        stamps: (V,) ns.
        delay: s that the images' stamps are late against those of the joint states.

    Raises:
        InputError: JOINT_MISSING.
    """
    (position,) = model.order(joints.names, joints.position)
    wanted = stamps - round(delay * 1e9)
    near = interpolate(joints.stamps, position, wanted, max_gap=GAP)
    wide = interpolate(joints.stamps, position, wanted, max_gap=WIDE_GAP)
    known = wide.found
    at = np.where(known[:, None], wide.values, 0.0)
    rotation, translation = frame_poses(model, at, hand_eye.parent)
    translation = rotation @ hand_eye.translation + translation
    rotation = rotation @ hand_eye.rotation
    rotation[~known], translation[~known] = np.nan, np.nan
    return Poses(rotation, translation, near.reason == Reason.FOUND, known)


def as_pose(rotation: Array, translation: Array) -> list[float]:
    """x y z (m) and quaternion x y z w."""
    return [*translation.tolist(), *quaternion_of_rotation(rotation).tolist()]
