"""The motion that a scan looks from: read, given its stops, commanded and supervised."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from poise.errors import ErrorCode, InputError, PoiseError
from poise.excitation.execution import (
    NOT_WATCHED,
    CommandedArm,
    HeldUp,
    JointWatch,
    ReadyStops,
    TimedMotion,
    joint_judge,
)
from poise.nodes.clock import node_seconds
from poise.nodes.runtime import coded
from poise.nodes.trajectory_message import trajectory_message
from poise.nodes.watchdog import ProcessWatchdog, WatchedGoal, execution_options, watch_limits
from poise.recording import stamp_of
from poise.robot import RobotModel
from poise.simulation import WaypointTrajectory, read_trajectory
from poise.types import Array

_WAYPOINT_PERIOD = 0.1
"""s between waypoints of the sweep."""


class SweptArm(Protocol):
    """What a sweep needs of a robot."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(J)."""

    @property
    def velocity_limit(self) -> Array:
        """(J,) rad/s."""


Motion = Callable[[Array], WaypointTrajectory]
"""The motion of a sweep that begins with the arm at (J,)."""


def motion_of_file(path: Path, model: RobotModel) -> Motion:
    """The motion in a trajectory file, wherever the arm is."""

    def read(_: Array) -> WaypointTrajectory:
        motion = read_trajectory(path, model)
        times = np.linspace(0.0, motion.duration, int(np.ceil(motion.duration / _WAYPOINT_PERIOD)) + 1)
        return WaypointTrajectory(times, *motion.at(times))

    return read


class SweepExecution:
    """The sweep of one goal. Call `tick` until the goal ends, then `close`.

    Args:
        node: of the goal.
        arm: publisher of the motion.
        watchdog: stops the arm when the node cannot.
        goal: for which it is.
        tolerance: rad that a joint may be off the sweep.
        model: the robot.
        motion: makes the sweep.

    Raises:
        InputError: TOPIC_MISSING while no controller is known.
    """

    def __init__(
        self,
        node: Node,
        arm: Any,
        watchdog: ProcessWatchdog,
        goal: WatchedGoal,
        tolerance: float,
        model: SweptArm,
        motion: Motion,
    ) -> None:
        if not arm.get_subscription_count():
            raise InputError(ErrorCode.TOPIC_MISSING, "no controller listens on joint_trajectory: remap or start it")
        self._tolerance, self._publisher, self._model, self._motion = tolerance, arm, model, motion
        self._options = execution_options(node)
        self._joints = JointWatch(model, self._options.stale)
        self._arm = CommandedArm(self._joints, self._send, watchdog, self._options)
        self._since = node_seconds()
        self._held_up = HeldUp(self._since, self._options)
        self.start: Array | None = None
        self._prepared: ReadyStops | PoiseError | None = None
        self.begun = self.over = False
        watchdog.watch(goal, model.joint_names, watch_limits(node))

    def add_joint_state(self, message: JointState) -> None:
        """Take a joint state."""
        self._joints.add(stamp_of(message), message.name, message.position, node_seconds())

    @property
    def seconds(self) -> float:
        """Of the motion; 0 before it is known."""
        return self._prepared.motion.duration if isinstance(self._prepared, ReadyStops) else 0.0

    def found_start(self, now: float) -> bool:
        """Whether it is known where the arm rests.

        Raises:
            PoiseError: it does not become known in time, or the arm moves.
        """
        problem = self._joints.problem(now)
        if problem is None and not self._joints.at_rest():
            problem = PoiseError(ErrorCode.BUSY, "the arm is moving: something else commands it; stop that")
        if problem is None:
            self.start = self._joints.position.copy()
        elif now - self._since > self._options.patience:
            raise problem
        return problem is None

    def prepare(self) -> None:
        """Make the motion and choose its stops; in the thread of the jobs. Never raises."""
        try:
            if self.start is None:
                raise PoiseError(ErrorCode.INTERNAL, "a sweep was prepared before the arm was known")
            judge = joint_judge(self._model.joint_names, self._model.velocity_limit)
            stops = ReadyStops.judged(self._motion(self.start), judge)
            self._arm.load(stops)
            self._since = node_seconds()
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
        self._held_up.tick(now)
        if not self.begun:
            self._begin(prepared, now)
            return
        self._arm.check()
        if not self._held_up.lately(now) and (problem := self._joints.problem(now)) is not None:
            raise problem
        self._arm.require_on_path(self._tolerance, "the sweep")
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
        if now - self._since < self._options.stopping:
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
            if now - self._since > self._options.patience:
                raise problem
            return
        away = float(np.abs(self._joints.position - stops.motion.position[0]).max())
        if away > self._tolerance:
            raise InputError(
                ErrorCode.NOT_FOLLOWING,
                f"the arm is {away:.2f} rad away from where the sweep begins: bring it there first (start_tolerance)",
            )
        self._arm.move(stops, now)
        self._since, self.begun = now, True

    def _send(self, command: TimedMotion) -> None:
        self._publisher.publish(trajectory_message(self._model.joint_names, command.motion, command.stamp))
