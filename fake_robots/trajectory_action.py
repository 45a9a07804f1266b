"""The action FollowJointTrajectory of a simulated arm, as joint_trajectory_controller of ros2_control serves it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectoryPoint

from poise.errors import ErrorCode, InputError
from poise.fake_robots.arm import SimulatedArm, Waypoints
from poise.fake_robots.commands import require_complete, seconds_of, waypoints_of
from poise.fake_robots.drive import BASE_JOINTS
from poise.fake_robots.following import Following, JointTolerances, Outcome, outcome_of
from poise.nodes.runtime import end_goal, guarded
from poise.types import Array

_LOOK = 0.02  # s between two looks at the motion
_FEEDBACK = 5  # looks between two feedbacks


@dataclass
class _Active:
    handle: ServerGoalHandle
    following: Following
    columns: list[int]
    command: int
    cancelled: bool = False
    looks: int = 0


class TrajectoryAction:
    """Serves one goal at a time; the next one replaces it.

    A goal that cannot be executed is accepted and then aborted, so that its client gets a code and a sentence;
    ros2_control rejects it without a reason.

    Args:
        node: that serves.
        arm: that moves.
        values: the parameters trajectory_action, allow_partial_joints_goal, goal_tolerance, path_tolerance, goal_time.
    """

    def __init__(self, node: Node, arm: SimulatedArm, values: dict[str, Any]) -> None:
        self._node, self._arm, self._values = node, arm, values
        self._joints = tuple(name for name in arm.model.joint_names if name not in BASE_JOINTS)
        self._active: _Active | None = None
        self._server = ActionServer(
            node,
            FollowJointTrajectory,
            values["trajectory_action"],
            lambda goal: FollowJointTrajectory.Result(),
            handle_accepted_callback=guarded(node, self._on_goal),
            cancel_callback=self._on_cancel,
        )
        node.create_timer(_LOOK, guarded(node, self._look))

    def close(self) -> None:
        """Serve no more."""
        self._server.destroy()

    def _on_goal(self, handle: ServerGoalHandle) -> None:
        try:
            following, columns, number = self._begin(handle.request)
        except InputError as error:
            self._end(handle, outcome_of(error), error.message)
            return
        self._replace("another goal has replaced this one")
        self._active = _Active(handle, following, columns, number)

    def _begin(self, goal: Any) -> tuple[Following, list[int], int]:
        """Command the motion of a goal.

        Raises:
            InputError: what is wrong with it; DEADLINE when it is in the past.
        """
        if goal.multi_dof_trajectory.points or goal.component_path_tolerance or goal.component_goal_tolerance:
            raise InputError(ErrorCode.BAD_INPUT, "joint trajectory: there are no joints of several degrees of freedom")
        waypoints = waypoints_of(goal.trajectory)
        require_complete(waypoints, self._joints, self._values["allow_partial_joints_goal"])
        joints = tuple(waypoints.names)
        on_path, at_end = (
            JointTolerances.read(
                joints, [(one.name, (one.position, one.velocity, one.acceleration)) for one in given], default
            )
            for given, default in (
                (goal.path_tolerance, self._values["path_tolerance"]),
                (goal.goal_tolerance, self._values["goal_tolerance"]),
            )
        )
        patience = seconds_of(goal.goal_time_tolerance)
        if patience < 0:
            raise InputError(ErrorCode.BAD_INPUT, "goal_time_tolerance is negative")
        late = self._arm.lateness(waypoints.stamp)
        if late > waypoints.times[-1]:
            raise InputError(
                ErrorCode.DEADLINE, f"joint trajectory: it ended {late - waypoints.times[-1]:.3f} s ago, by its stamp"
            )
        number, begin = self._arm.command(waypoints)
        end = begin + float(waypoints.times[-1]) - max(late, 0.0)
        goal_position = np.asarray(waypoints.position)[-1]
        following = Following(joints, goal_position, end, on_path, at_end, patience or self._values["goal_time"])
        return following, [self._arm.model.joint_names.index(name) for name in joints], number

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        active = self._active
        if active is not None and active.handle is handle and not active.cancelled:
            active.cancelled = True
            active.command, _ = self._arm.command(_STOP)
        return CancelResponse.ACCEPT

    def _look(self) -> None:
        active = self._active
        if active is None:
            return
        if active.command != self._arm.commands:
            self._replace("another command has replaced this goal")
            return
        latest = math.inf if active.cancelled else active.following.deadline
        now, commanded, actual = self._state(active.columns, latest)
        if active.cancelled:
            if not np.any(actual[1:]):
                self._finish(Outcome.SUCCESSFUL, "cancelled: the arm has stopped")
            return
        ended = active.following.judge(now, commanded, actual)
        if ended is not None:
            if ended[0] is Outcome.PATH_TOLERANCE_VIOLATED:
                self._arm.command(_STOP)
            self._finish(*ended)
        elif active.looks % _FEEDBACK == 0:
            active.handle.publish_feedback(self._feedback(active, now, commanded, actual))
        active.looks += 1

    def _state(self, columns: list[int], latest: float) -> tuple[float, Array, Array]:
        now = min(self._arm.now, latest)
        commanded, actual = (np.stack([part[0, columns] for part in motion]) for motion in self._arm.states(now))
        return now, commanded, actual

    def _replace(self, why: str) -> None:
        if self._active is not None:
            self._finish(Outcome.INVALID_GOAL, why)

    def _finish(self, code: Outcome, sentence: str) -> None:
        active, self._active = self._active, None
        if active is not None:
            self._end(active.handle, code, sentence)

    def _end(self, handle: ServerGoalHandle, code: Outcome, sentence: str) -> None:
        if code is not Outcome.SUCCESSFUL:
            self._node.get_logger().error(f"{code.name}: {sentence}")

        def end(goal: ServerGoalHandle) -> FollowJointTrajectory.Result:
            end_goal(goal, code is Outcome.SUCCESSFUL and not goal.is_cancel_requested)
            return FollowJointTrajectory.Result(error_code=int(code), error_string=sentence)

        handle.execute(end)

    def _feedback(self, active: _Active, now: float, commanded: Array, actual: Array) -> Any:
        said = FollowJointTrajectory.Feedback(joint_names=list(active.following.joints))
        seconds, nanoseconds = divmod(self._arm.stamp(now), 10**9)
        said.header.stamp = Time(sec=seconds, nanosec=nanoseconds)
        for point, value in ((said.desired, commanded), (said.actual, actual), (said.error, commanded - actual)):
            _fill(point, value)
        return said


def _fill(point: JointTrajectoryPoint, value: Array) -> None:
    point.positions, point.velocities, point.accelerations = (row.tolist() for row in value)


_STOP = Waypoints([], np.zeros(0), np.zeros((0, 0)))
