"""Managed nodes, and a fix for rclpy 7.1's lifecycle nodes."""

from typing import Any

from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNode


class ManagedNode(LifecycleNode):
    """A node with a lifecycle. A subclass declares `autostart`, and calls `start` when it is complete.

    Args:
        name: of the node.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        survive_impossible_transitions(self)

    def start(self) -> None:
        """Configure and activate, when `autostart` says so."""
        if self.get_parameter("autostart").value:
            self.trigger_configure()
            self.trigger_activate()


def survive_impossible_transitions(node: LifecycleNode) -> None:
    """Answer a transition that the present state does not allow with success=False.

    In rclpy the state machine's refusal escapes from the service callback and ends the node.
    """
    service = node._service_change_state
    change_state = service.callback

    def change_state_or_refuse(request: Any, response: Any) -> Any:
        try:
            return change_state(request, response)
        except RCLError as error:
            node.get_logger().error(f"transition refused: {error}")
            response.success = False
            return response

    service.callback = change_state_or_refuse
