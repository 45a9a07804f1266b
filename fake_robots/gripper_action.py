"""The action GripperCommand of a simulated gripper, as gripper_action_controller of ros2_control serves it."""

import math
from typing import Any

import numpy as np
from control_msgs.action import GripperCommand
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from poise.fake_robots.arm import SimulatedArm
from poise.fake_robots.gripper import SimulatedGripper
from poise.nodes.runtime import end_goal, guarded

_LOOK = 0.02  # s between two looks at the fingers
_NEAR = 1e-3
"""Of the whole way: nearer than that, the fingers are at their goal; slower than that in a second, they rest."""
_STALLED = 0.2
"""s at rest before the goal after which the fingers count as stalled."""
_FEEDBACK = 5  # looks between two feedbacks


class GripperAction:
    """Serves one goal at a time; the next one replaces it. Positions are those of the gripper's joint, rad or m.

    Args:
        node: that serves.
        arm, gripper: that move.
        name: of the action.
        allow_stalling: fingers that a body stops have reached what was wanted; False: such a goal is aborted.
    """

    def __init__(
        self, node: Node, arm: SimulatedArm, gripper: SimulatedGripper, name: str, allow_stalling: bool
    ) -> None:
        self._node, self._arm, self._gripper, self._allow_stalling = node, arm, gripper, allow_stalling
        self._goal: ServerGoalHandle | None = None
        self._target = 0.0
        self._rests_since = 0.0
        self._looks = 0
        self._server = ActionServer(
            node,
            GripperCommand,
            name,
            lambda goal: GripperCommand.Result(),
            handle_accepted_callback=guarded(node, self._on_goal),
            cancel_callback=self._on_cancel,
        )
        node.create_timer(_LOOK, guarded(node, self._look))

    def close(self) -> None:
        """Serve no more."""
        self._server.destroy()

    def _on_goal(self, handle: ServerGoalHandle) -> None:
        command = handle.request.command
        position, effort = command.position, command.max_effort
        low, high = sorted((self._gripper.travel.opened, self._gripper.travel.closed))
        if not (math.isfinite(position) and math.isfinite(effort) and low <= position <= high and effort >= 0):
            self._node.get_logger().error(
                f"gripper command: position {position} must be from {low} to {high}, max_effort {effort} not negative"
            )
            self._end(handle, False)
            return
        if self._goal is not None:
            self._end(self._goal, False)
        self._arm.grip([self._gripper.joint], position, effort)
        self._goal, self._target, self._rests_since, self._looks = handle, position, self._arm.now, 0

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if handle is self._goal and not self._state()[2]:  # the fingers stay where they are; what they hold stays held
            self._arm.grip([self._gripper.joint], self._state()[0])
        return CancelResponse.ACCEPT

    def _look(self) -> None:
        goal = self._goal
        if goal is None:
            return
        _, velocity, _ = self._state()
        if velocity:
            self._rests_since = self._arm.now
        if goal.is_cancel_requested or self._gripper.target != self._target:
            self._goal = None
            self._end(goal, False)
        elif self._reached or self._stalled:
            self._goal = None
            self._end(goal, self._reached or self._allow_stalling)
        elif self._looks % _FEEDBACK == 0:
            goal.publish_feedback(self._said(GripperCommand.Feedback()))
        self._looks += 1

    @property
    def _reached(self) -> bool:
        travel = self._gripper.travel
        return abs(self._state()[0] - self._target) <= _NEAR * abs(travel.closed - travel.opened)

    @property
    def _stalled(self) -> bool:
        return not self._reached and self._arm.now - self._rests_since > _STALLED

    def _state(self) -> tuple[float, float, float]:
        position, velocity, effort = self._gripper.at(np.array([self._arm.now]))
        return float(position[0]), float(velocity[0]), float(effort[0])

    def _said(self, message: Any) -> Any:
        message.position, _, message.effort = self._state()
        message.stalled, message.reached_goal = self._stalled, self._reached
        return message

    def _end(self, handle: ServerGoalHandle, succeeded: bool) -> None:
        result = self._said(GripperCommand.Result())

        def end(goal: ServerGoalHandle) -> GripperCommand.Result:
            end_goal(goal, succeeded and not goal.is_cancel_requested)
            return result

        handle.execute(end)
