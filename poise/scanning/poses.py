"""Where the camera was: joint states and a robot description give the hand, a hand-eye transform gives the camera."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.recording import JointStream, Reason, interpolate
from poise.robot import FrameTree, Mounting, RobotModel, frame_poses, parse_urdf
from poise.types import Mask

_GAP, _WIDE_GAP = 0.1, 3.0
"""s between joint states across which a pose is trusted, and across which it is guessed."""


@dataclass(frozen=True, eq=False)
class CameraPoses(Pose):
    """Where a camera was at V stamps, in the robot's base.

    Args:
        rotation: (V, 3, 3), world <- camera.
        translation: (V, 3) m.
        sure: (V,) False where joint states were too far apart and the pose is interpolated.
        known: (V,) False where nothing is known; the pose is then NaN.
    """

    sure: Mask
    known: Mask


def hand_eye_of(description: str, camera_frame: str, fixed: Sequence[Mounting]) -> Mounting:
    """The camera's frame in the link of the robot that carries it.

    Args:
        description: URDF.
        camera_frame: of the images.
        fixed: from tf_static and from the user; later ones take precedence.

    Raises:
        InputError: ROBOT_DESCRIPTION_INVALID; FRAME_UNKNOWN when nothing connects the camera to the robot.
    """
    links, tree = parse_urdf(description).links, FrameTree(one_parent=False, keep=False)
    for mounting in fixed:
        tree.add_mounting(mounting)
    for frame, pose in tree.ancestors(camera_frame).items():
        if frame in links:
            return Mounting(pose.rotation, pose.translation, frame, camera_frame)
    raise InputError(
        ErrorCode.FRAME_UNKNOWN,
        f"no hand-eye transform: neither robot_description nor tf_static connects the camera frame {camera_frame!r} to"
        " a link of the robot; record tf_static, or give the link and x y z qx qy qz qw of the camera's optical frame"
        " in it (hand_eye)",
    )


def camera_poses(
    model: RobotModel, joints: JointStream, hand_eye: Mounting, stamps: NDArray[np.int64], delay: float = 0.0
) -> CameraPoses:
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
    near = interpolate(joints.stamps, position, wanted, max_gap=_GAP)
    wide = interpolate(joints.stamps, position, wanted, max_gap=_WIDE_GAP)
    known = wide.found
    at = np.where(known[:, None], wide.values, 0.0)
    rotation, translation = frame_poses(model, at, hand_eye.parent)
    translation = rotation @ hand_eye.translation + translation
    rotation = rotation @ hand_eye.rotation
    rotation[~known], translation[~known] = np.nan, np.nan
    return CameraPoses(rotation, translation, near.reason == Reason.FOUND, known)
