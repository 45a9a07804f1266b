"""Frames get their poses: from joint states and a URDF, or from tf."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.recording import JointStream, PoseStream
from poise.robot import FrameTree, Mounting, RobotModel
from poise.scanning.frames import Frame, View
from poise.scanning.poses import CameraPoses, camera_poses, hand_eye_of

_GAP, _WIDE_GAP = 0.2, 3.0
"""s between transforms across which a pose is trusted, and across which it is guessed."""
PosesAt = Callable[[float], CameraPoses]
"""Camera poses at the frames' stamps less a delay, s."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """Views of a scene.

    Args:
        views: with their poses in the robot's base.
        base: the name of that frame.
        notes: what was left out, one sentence each.
        poses_at: the poses of the frames, were the images' stamps late by another delay, s; None: not known.
        frames: those that `poses_at` gives poses of.
    """

    views: list[View]
    base: str
    notes: tuple[str, ...] = ()
    poses_at: PosesAt | None = None
    frames: tuple[Frame, ...] = ()

    def delayed(self, delay: float) -> list[View]:
        """The views, were the images' stamps late by so many s more."""
        return self.views if self.poses_at is None else views_of(self.frames, self.poses_at(delay))


def place(
    frames: Sequence[Frame],
    description: str,
    fixed: Sequence[Mounting],
    joints_of: Callable[[tuple[str, ...]], JointStream],
    hand_eye: Mounting | None = None,
    delay: float = 0.0,
) -> Sweep:
    """Give frames their poses by joint states; those without are left out and reported.

    Args:
        frames: of one camera.
        description: URDF.
        fixed: from tf_static.
        joints_of: the states of joints by their names.
        hand_eye: the camera's optical frame in a link of the robot; None: from the description and `fixed`.
        delay: s that the images' stamps are late.

    Raises:
        InputError: as `hand_eye_of` and `camera_poses`; EMPTY when no frame has a pose; FRAME_UNKNOWN for frames of
            several cameras.
    """
    name = camera_frame(frames)
    given = [] if hand_eye is None else [replace(hand_eye, child=name)]
    mounted = hand_eye_of(description, name, [*fixed, *given])
    model = RobotModel.from_urdf(description, mounted.parent)
    joints = joints_of(model.joint_names)
    stamps = np.array([frame.stamp for frame in frames])

    def poses_at(more: float) -> CameraPoses:
        return camera_poses(model, joints, mounted, stamps, delay + more)

    return _swept(frames, poses_at, model.base_frame, "joint_states", joints.stamps)


def place_by_tf(
    frames: Sequence[Frame], transforms: Sequence[PoseStream], base: str, fixed: Sequence[Mounting], delay: float = 0.0
) -> Sweep:
    """Give frames their poses by transforms, from the camera's frame up to the base.

    Args:
        frames: of one camera.
        transforms: of the camera's frame in its parent, and so on; and of the base's, where the base moves.
        base: the frame whose z points up; empty: the topmost.
        fixed: transforms that are given besides.
        delay: s that the images' stamps are late.

    Raises:
        InputError: FRAME_UNKNOWN when nothing connects the camera with the base; EMPTY when no frame has a pose.
    """
    name = camera_frame(frames)
    trees = FrameTree(one_parent=False, max_gap=_GAP), FrameTree(one_parent=False, max_gap=_WIDE_GAP)
    for tree in trees:
        for one in transforms:
            tree.add_stream(one)
        for mounting in fixed:
            tree.add_mounting(mounting)
    top = base or trees[0].top(name)
    if top == name:
        raise InputError(ErrorCode.FRAME_UNKNOWN, f"tf says nothing of the camera's frame {name!r}: record tf")
    stamps = np.array([frame.stamp for frame in frames])

    def poses_at(more: float) -> CameraPoses:
        wanted = stamps - round((delay + more) * 1e9)
        (_, near), (pose, known) = (tree.poses(name, top, wanted) for tree in trees)
        return CameraPoses(pose.rotation, pose.translation, near, known)

    moving = [one.stamps for one in transforms if len(one.stamps) > 1]
    return _swept(frames, poses_at, top, "tf", moving[0] if moving else stamps)


def camera_frame(frames: Sequence[Frame]) -> str:
    """The optical frame of all frames.

    Raises:
        InputError: FRAME_UNKNOWN for frames of several cameras.
    """
    names = sorted({frame.frame_id for frame in frames})
    if len(names) != 1:
        raise InputError(
            ErrorCode.FRAME_UNKNOWN, f"scan: frames of {len(names)} cameras ({', '.join(names)}): choose one of them"
        )
    return names[0]


def _swept(
    frames: Sequence[Frame], poses_at: PosesAt, base: str, source: str, source_stamps: NDArray[np.int64]
) -> Sweep:
    poses, stamps = poses_at(0.0), np.array([frame.stamp for frame in frames])
    if not poses.known.any():
        raise InputError(
            ErrorCode.EMPTY,
            f"scan: {source} ({_span(source_stamps)}) and images ({_span(stamps)}) do not overlap in time: record"
            " them together, with one clock",
        )
    notes = []
    if not poses.known.all():
        lost = int(np.sum(~poses.known))
        notes.append(f"{lost} of {len(frames)} frames have no {source} around them and were left out")
    guessed = int(np.sum(poses.known & ~poses.sure))
    if guessed:
        notes.append(f"{guessed} frames fall into gaps of {source}; their poses were interpolated")
    return Sweep(views_of(frames, poses), base, tuple(notes), poses_at, tuple(frames))


def views_of(frames: Sequence[Frame], poses: CameraPoses) -> list[View]:
    """Frames with their poses, where there is one."""
    return [
        View(frame, poses.rotation[i], poses.translation[i], bool(poses.sure[i]))
        for i, frame in enumerate(frames)
        if poses.known[i]
    ]


def turned_in_hand(view: View, change: Pose) -> View:
    """The view, were the camera at another pose on the hand: `change` is in its own frame."""
    return replace(
        view,
        rotation_world_camera=view.rotation_world_camera @ change.rotation,
        translation_world_camera=view.translation_world_camera + view.rotation_world_camera @ change.translation,
    )


def _span(stamps: NDArray[np.int64]) -> str:
    if not len(stamps):
        return "none"
    return f"{stamps.min() * 1e-9:.2f} to {stamps.max() * 1e-9:.2f} s"
