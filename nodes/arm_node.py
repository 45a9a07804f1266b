"""Managed nodes that move an arm or a base; drivers, which do without, start in half the time."""

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from poise.nodes.lifecycle import ManagedNode
from poise.nodes.parameters import AUTOSTART, Parameter, declare_parameters
from poise.nodes.watchdog import WATCHDOG_DYNAMIC, WATCHDOG_PARAMETERS, ProcessWatchdog

ARM_NODE_PARAMETERS = (AUTOSTART, *WATCHDOG_PARAMETERS)


class MovingNode(ManagedNode):
    """A node whose action moves the robot: it takes goals while it is active; its other functions always work.

    A subclass sets `watchdog`, which serves the action, and calls `start` when it is complete.

    Args:
        name: of the node.
    """

    watchdog: ProcessWatchdog
    motion_parameters: tuple[Parameter, ...] = (AUTOSTART,)
    """Declared before those of the subclass."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        declare_parameters(self, self.motion_parameters, WATCHDOG_DYNAMIC)

    def halt(self, reason: str) -> None:
        """Stop the motion and end the goal."""
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
        """End the watchdog, which stops the motion, before the node goes."""
        if hasattr(self, "watchdog"):
            self.watchdog.close()
        super().destroy_node()

    def _close(self, reason: str) -> None:
        self.watchdog.open(False)
        self.halt(reason)


class ArmNode(MovingNode):
    """A node whose action moves an arm, which the watchdog stops; args: as `MovingNode`."""

    motion_parameters = ARM_NODE_PARAMETERS
