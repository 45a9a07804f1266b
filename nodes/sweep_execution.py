"""The motion that a scan looks from: read, given its stops, commanded and supervised."""

import time
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from poise.errors import ErrorCode, InputError, PoiseError
from poise.excitation.execution import (
    NOT_WATCHED,
    CommandedArm,
    ExecutionOptions,
    JointWatch,
    ReadyStops,
    TimedMotion,
    joint_judge,
)
from poise.nodes.runtime import coded
from poise.nodes.trajectory_message import trajectory_message
from poise.nodes.watchdog import ProcessWatchdog, WatchedGoal, watch_limits
from poise.recording import stamp_of
from poise.robot import RobotModel
from poise.simulation import WaypointTrajectory, read_trajectory

_WAYPOINT_PERIOD = 0.1
"""s between waypoints of the sweep."""
_OPTIONS = ExecutionOptions()


class SweepExecution:
    """The sweep of one goal. Call `tick` until the goal ends, then `close`.

    Args:
        node: of the goal.
        arm: publisher of the motion.
        watchdog: stops the arm when the node cannot.
        goal: for which it is.
        values: parameters of the node.
        text: URDF of the robot.

    Raises:
        InputError: TOPIC_MISSING, ROBOT_DESCRIPTION_MISSING while the robot is not known.
    """

    def __init__(
        self, node: Node, arm: Any, watchdog: ProcessWatchdog, goal: WatchedGoal, values: dict[str, Any], text: str
    ) -> None:
        if not arm.get_subscription_count():
            raise InputError(ErrorCode.TOPIC_MISSING, "no controller listens on joint_trajectory: remap or start it")
        if not text:
            raise InputError(ErrorCode.ROBOT_DESCRIPTION_MISSING, "there is no robot_description to sweep with")
        self._values, self._publisher = values, arm
        self._model = RobotModel.from_urdf(text, values["hand_frame"])
        self._joints = JointWatch(self._model)
        self._arm = CommandedArm(self._joints, self._send, watchdog)
        self._since = time.monotonic()
        self._prepared: ReadyStops | PoiseError | None = None
        self.begun = self.over = False
        watchdog.watch(goal, self._model.joint_names, watch_limits(node))

    def add_joint_state(self, message: JointState) -> None:
        """Take a joint state."""
        self._joints.add(stamp_of(message), message.name, message.position, time.monotonic())

    def prepare(self) -> None:
        """Read the motion and choose its stops; in the thread of the jobs. Never raises."""
        try:
            motion = read_trajectory(Path(self._values["sweep"]), self._model)
            times = np.linspace(0.0, motion.duration, int(np.ceil(motion.duration / _WAYPOINT_PERIOD)) + 1)
            judge = joint_judge(self._model.joint_names, self._model.velocity_limit)
            stops = ReadyStops.judged(WaypointTrajectory(times, *motion.at(times)), judge)
            self._arm.load(stops)
            self._prepared = stops
        except Exception as failure:
            self._prepared = coded(failure)

    def tick(self, now: float) -> None:
        """Begin to move once everything is ready, then supervise the motion.

        Raises:
            PoiseError: it has to stop; call `stop` until that is done.
        """
        prepared = self._prepared
        if prepared is None or self.over:
            return
        if isinstance(prepared, PoiseError):
            raise prepared
        if not self.begun:
            self._begin(prepared, now)
            return
        self._arm.check()
        if (problem := self._joints.problem(now)) is not None:
            raise problem
        self._arm.require_on_path(self._values["start_tolerance"], "the sweep")
        if self._arm.seconds > prepared.motion.duration:
            self._arm.ended()
            self.over = True

    def stop(self, error: PoiseError, now: float) -> str | None:
        """Send the stop; what is to be said of it, or None: call again."""
        if not self._arm.moving and not self._arm.stopped:
            return ""
        sent = self._arm.hold(error, now) if error.code is ErrorCode.NOT_FOLLOWING else self._arm.stop(error, now)
        if sent:
            return f"; no stop kept the limits: {self._arm.excess}" if self._arm.excess else ""
        if now - self._since < _OPTIONS.stopping:
            return None
        return f"; the stop could not be sent: {self._arm.failure!r}"

    def stopping(self, now: float) -> None:
        """An error has come: `stop` is called from now on."""
        self._since = now

    def _begin(self, stops: ReadyStops, now: float) -> None:
        problem = self._joints.problem(now)
        if problem is None and not self._arm.ready:
            problem = PoiseError(ErrorCode.BUSY, NOT_WATCHED)
        if problem is not None:
            if now - self._since > _OPTIONS.patience:
                raise problem
            return
        away = float(np.abs(self._joints.position - stops.motion.position[0]).max())
        if away > self._values["start_tolerance"]:
            raise InputError(
                ErrorCode.NOT_FOLLOWING,
                f"the arm is {away:.2f} rad away from where the sweep begins: bring it there first (start_tolerance)",
            )
        self._arm.move(stops, now)
        self._since, self.begun = now, True

    def _send(self, command: TimedMotion) -> None:
        self._publisher.publish(trajectory_message(self._model.joint_names, command.motion, command.stamp))
