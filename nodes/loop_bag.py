"""One bag with all topics of a running graph, but images."""

import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from poise.recording import LATCHED_TOPICS, RecordingWriter

_LOOK = 2.0
"""s between looks for new topics."""
_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
"""Kinds that are left out: a camera that is listened to all the time takes most of a processor."""


class LoopBag:
    """Records what is published; call `look` now and then.

    Args:
        node: that listens.
        writer: of the bag, open.
    """

    def __init__(self, node: Node, writer: RecordingWriter) -> None:
        self._node, self._writer = node, writer
        self._topics: set[str] = set()
        self._types: Any = None
        self._looked = -_LOOK
        self.count = 0
        """Messages so far."""

    def look(self) -> None:
        """Listen to topics that are new."""
        if time.monotonic() < self._looked + _LOOK:
            return
        self._looked = time.monotonic()
        for topic, kinds in self._node.get_topic_names_and_types():
            plain = len(kinds) == 1 and "/msg/" in kinds[0] and kinds[0] not in _IMAGES
            if plain and topic not in self._topics:
                self._topics.add(topic)
                self._listen(topic, kinds[0])

    def _listen(self, topic: str, kind: str) -> None:
        package, _, name = kind.split("/")
        try:
            message_type, definition = getattr(import_module(f"{package}.msg"), name), self._definition(kind)
        except (ImportError, AttributeError, KeyError, TypesysError):
            self._node.get_logger().warning(f"{topic} is not in the bag: the type {kind} is not known here")
            return
        self._writer.add_topic(topic, kind, definition=definition)
        own = self._node.get_publishers_info_by_topic(topic)
        latched = topic.rpartition("/")[2] in LATCHED_TOPICS or any(
            each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in own
        )
        loose = any(each.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for each in own)
        qos = QoSProfile(
            depth=100,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
            reliability=ReliabilityPolicy.BEST_EFFORT if loose else ReliabilityPolicy.RELIABLE,
        )
        self._node.create_subscription(message_type, topic, self._writer_of(topic), qos, raw=True)

    def _writer_of(self, topic: str) -> Callable[[bytes], None]:
        def write(data: bytes) -> None:
            self.count += 1
            self._writer.write(topic, self._node.get_clock().now().nanoseconds, data)

        return write

    def _definition(self, kind: str) -> str:
        if self._types is None:
            self._types = get_typestore(Stores.ROS2_JAZZY)
            found: dict[str, Any] = {}
            for package in ("poise_msgs", "tf2_msgs", "control_msgs"):
                for file in sorted((Path(get_package_share_directory(package)) / "msg").glob("*.msg")):
                    found |= get_types_from_msg(file.read_text(encoding="utf-8"), f"{package}/msg/{file.stem}")
            self._types.register({name: what for name, what in found.items() if name not in self._types.fielddefs})
        return str(self._types.generate_msgdef(kind, ros_version=2)[0])
