"""What is true in the world of a fake robot, to compare with what the loop found; no node of the loop reads it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rclpy.node import Node
from tf2_msgs.msg import TFMessage

from poise.assembly import RigidObject, load_scene
from poise.geometry import Pose
from poise.nodes.transforms import pose_between, pose_of_transform
from poise.robot import FrameTree
from poise.types import Array


class LoopTruth:
    """The objects of the scene file, at the poses of the topic world_truth.

    Args:
        node: that listens.
        scene: the file.
        frames: of tf.
    """

    def __init__(self, node: Node, scene: str, frames: FrameTree) -> None:
        self._items = {item.id: item for item in load_scene(Path(scene)).objects if not item.fixed}
        self._frames, self._poses, self._frame = frames, dict[str, Pose](), ""
        self._names: dict[str, str] = {}
        node.create_subscription(TFMessage, "world_truth", self._on_truth, 10)

    def _on_truth(self, message: TFMessage) -> None:
        for each in message.transforms:
            self._frame = each.header.frame_id
            self._poses[each.child_frame_id] = pose_of_transform(each.transform)

    def match(self, name: str, pose: Pose, frame: str) -> None:
        """Find the true object of a scanned one: the nearest that no other is."""
        place = (self._to_world(frame) @ pose).translation
        self._names.pop(name, None)
        free = {true: self._poses[true] for true in self._items if true in self._poses}
        free = {true: there for true, there in free.items() if true not in self._names.values()}
        if free:
            self._names[name] = min(free, key=lambda true: float(np.linalg.norm(free[true].translation - place)))

    def name(self, name: str) -> str:
        """The true object that a scanned one is; empty: not known."""
        return self._names.get(name, "")

    def weight(self, name: str, frame: str) -> tuple[float, Array] | None:
        """kg, and (3,) m centre of mass of what the hand holds, in a frame of the hand.

        That is the true object nearest to the hand: the scan may have taken two neighbours for one object.
        """
        hand = self._to_world(frame)
        centres = {
            true: hand.undo(self._poses[true].apply(_com(item)))
            for true, item in self._items.items()
            if true in self._poses
        }
        if not centres:
            return None
        held = min(centres, key=lambda true: float(np.linalg.norm(centres[true])))
        self._names[name] = held
        return self._items[held].mass, centres[held]

    def places(self, frame: str, without: Sequence[str]) -> dict[str, Array]:
        """(3,) m of the true objects that the loop knows, in a frame, by their ids; some left out by their names."""
        back = self._to_world(frame).inverse
        known = [true for name, true in self._names.items() if true in self._poses and name not in without]
        return {true: (back @ self._poses[true]).translation for true in known}

    def _to_world(self, frame: str) -> Pose:
        return pose_between(self._frames, frame, self._frame or frame)


def _com(item: RigidObject) -> Array:
    return np.asarray(item.shape.centroid if item.com is None else item.com)
