"""Publishes the state of a node where the diagnostic aggregator reads it, also for nodes in a namespace."""

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from poise.nodes.runtime import publish

OK, WARN, ERROR = 0, 1, 2
"""Levels of diagnostic_msgs/DiagnosticStatus."""
_TOPIC = "/diagnostics"
"""Absolute, as in diagnostic_updater: one aggregator reads the nodes of all namespaces. It can be remapped."""


class DiagnosticsPublisher:
    """Publishes diagnostic_msgs/DiagnosticArray with one status, named by the node's full name.

    Args:
        node: whose state it is.
        part: of the node, when the status concerns only that.
    """

    def __init__(self, node: Node, part: str = "") -> None:
        self._node = node
        self._name = node.get_fully_qualified_name().lstrip("/") + (f": {part}" if part else "")
        self._publisher = node.create_publisher(DiagnosticArray, _TOPIC, 10)

    def publish(self, level: int, message: str, values: Mapping[str, object], hardware_id: str = "") -> None:
        """Publish a status; `level` is OK, WARN or ERROR. Any thread may call this."""
        status = DiagnosticStatus(level=bytes([level]), name=self._name, message=message, hardware_id=hardware_id)
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        publish(self._publisher, array)

    def destroy(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)
