"""Managed nodes, those of them that move an arm, and a fix for rclpy 7.1's lifecycle nodes."""

from typing import Any

from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from poise.nodes.parameters import AUTOSTART, declare_parameters
from poise.nodes.watchdog import WATCHDOG_DYNAMIC, WATCHDOG_PARAMETERS, ProcessWatchdog

ARM_NODE_PARAMETERS = (AUTOSTART, *WATCHDOG_PARAMETERS)


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


class ArmNode(ManagedNode):
    """A node whose action moves an arm: it takes goals while it is active; its other functions always work.

    A subclass sets `watchdog`, which serves the action, and calls `start` when it is complete.

    Args:
        name: of the node.
    """

    watchdog: ProcessWatchdog

    def __init__(self, name: str) -> None:
        super().__init__(name)
        declare_parameters(self, ARM_NODE_PARAMETERS, WATCHDOG_DYNAMIC)

    def halt(self, reason: str) -> None:
        """Stop the arm and end the goal."""
        raise NotImplementedError

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take goals."""
        self.watchdog.open()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, and take no goals."""
        self._close("the node was deactivated")
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, and take no goals."""
        self._close("the node was shut down")
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """End the watchdog, which stops the arm, before the node goes."""
        if hasattr(self, "watchdog"):
            self.watchdog.close()
        super().destroy_node()

    def _close(self, reason: str) -> None:
        self.watchdog.open(False)
        self.halt(reason)


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
