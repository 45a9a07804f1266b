"""Objects whose shapes and places are given, published as object_scanner publishes scans: a loop without a camera."""

from pathlib import Path

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from poise.assembly import Mesh, RigidObject, load_scene
from poise.nodes.assembly_message import mesh_message
from poise.nodes.runtime import LATCHED
from poise_msgs.msg import Part, SegmentedObject


class LoopScan:
    """Publishes one movable object of a scene after the other, without its weight.

    Args:
        node: that publishes.
        scene: the file; its frame is `frame`.
        frame: of the poses.
    """

    def __init__(self, node: Node, scene: str, frame: str = "world") -> None:
        self._node, self._frame = node, frame
        self._items = [item for item in load_scene(Path(scene)).objects if not item.fixed]
        self.names = [f"object_{number}" for number in range(1, len(self._items) + 1)]
        """That the objects get."""
        self._scans = node.create_publisher(SegmentedObject, "segmented_object", LATCHED)
        self._transforms = node.create_publisher(TFMessage, "tf_static", LATCHED)

    def publish(self, name: str) -> None:
        """Publish one object under its name."""
        stamp = self._node.get_clock().now().to_msg()
        message, there = as_scan(self._items[self.names.index(name)], name, self._frame)
        message.header.stamp = there.header.stamp = stamp
        self._transforms.publish(TFMessage(transforms=[there]))
        self._scans.publish(message)


def as_scan(item: RigidObject, name: str, frame: str) -> tuple[SegmentedObject, TransformStamped]:
    """What object_scanner publishes of an object that it sees without errors, and where that is in a frame."""
    low, high = item.vertices.min(axis=0), item.vertices.max(axis=0)
    foot = np.array([*(low + high)[:2] / 2, low[2]])
    solid, volume = item.shape.polyhedron, float(item.shape.volume)
    even = RigidObject(name, item.shape, item.pose, mass=1.0)
    part = Part(volume=volume, surface=mesh_message(Mesh(item.vertices - foot, solid.triangles)))
    unit, tensor = part.unit_inertia, even.inertia_in_world
    unit.m = 1.0
    unit.com.x, unit.com.y, unit.com.z = (even.com_in_world - foot).tolist()
    unit.ixx, unit.ixy, unit.ixz, unit.iyy, unit.iyz, unit.izz = tensor[np.triu_indices(3)].tolist()
    message = SegmentedObject(id=name, header=Header(frame_id=name), volume=volume, parts=[part])
    there = TransformStamped(child_frame_id=name, header=Header(frame_id=frame))
    shift = there.transform.translation
    shift.x, shift.y, shift.z = foot.tolist()
    return message, there
