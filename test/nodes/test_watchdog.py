"""A watchdog in its own process stops the arm while the executor of its node does nothing."""

import os
import signal
import socket
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from action_caller import Caller
from geometry_msgs.msg import WrenchStamped
from rclpy.action import GoalResponse
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode, PoiseError
from poise.excitation.execution import CommandedArm, JointWatch, ReadyStops
from poise.nodes.motion_watch import WatchLimits
from poise.nodes.watchdog import ProcessWatchdog
from poise.nodes.watchdog_link import QueuedLink, WatchdogLink
from poise.nodes.watchdog_process import WatchdogNode
from poise.recording import stamp_of
from poise.simulation import WaypointTrajectory
from poise_msgs.action import IdentifyPayload

pytestmark = pytest.mark.ros
NAMES = ("a", "b")
MOTION = WaypointTrajectory(np.array([0.0, 4.0]), np.array([[0.0, 0.0], [0.5, -0.5]]))
LIMITS = WatchLimits(silence=1.5, unattended=1e3, force=10.0, needs_wrench=True)


class BlockedNode:
    """A node whose executor is not run while the arm moves; messages are published and taken without it."""

    joint_names = NAMES

    def __init__(self, graph):
        self.graph, self.goals = graph, []
        self.watchdog = ProcessWatchdog(graph.node, IdentifyPayload, "identify_payload", self.goals.append)
        self.watchdog.open()
        self._states = graph.node.create_publisher(JointState, "joint_states", 10)
        self._wrenches = graph.node.create_publisher(WrenchStamped, "wrench", 10)
        self._commands = graph.node.create_subscription(JointTrajectory, "joint_trajectory", lambda _: None, 10)
        self.joints, self.force, self.sent = JointWatch(self), 0.0, []

    def speak(self):
        state, wrench = JointState(name=list(NAMES), position=[0.0, 0.0]), WrenchStamped()
        state.header.stamp = wrench.header.stamp = self.graph.node.get_clock().now().to_msg()
        wrench.wrench.force.x = self.force
        self._states.publish(state)
        self._wrenches.publish(wrench)
        self.joints.add(stamp_of(state), NAMES, state.position, time.monotonic())

    def speak_for_others(self):
        """Wrenches, and joint states of a gripper, so close that not all of them would be read."""
        self._wrenches.publish(WrenchStamped())
        for _ in range(3):
            self._states.publish(JointState(name=["finger"], position=[0.0]))

    def moving(self, caller, stops):
        """A goal whose motion was commanded; nothing of the node runs from here on."""
        handle = caller.send()
        self.graph.wait_for(lambda: self.goals, what="the goal")
        goal = self.goals.pop()
        self.watchdog.watch(goal, NAMES, LIMITS)
        self.force = 0.0
        self.until(lambda: self.watchdog.ready)
        arm = CommandedArm(self.joints, self.sent.append, self.watchdog)
        arm.load(stops)
        arm.move(stops, time.monotonic())
        self.until(lambda: False, 0.15)
        return handle, goal, arm

    def until(self, condition, seconds=30.0, silent=""):
        """Publish, but run no callback, until a condition holds."""
        end = time.monotonic() + seconds
        while not (found := condition()) and time.monotonic() < end:
            if not silent:
                self.speak()
            elif silent == "arm":
                self.speak_for_others()
            time.sleep(0.005)
        return found

    def command(self):
        """The next command for the arm, without the executor."""
        with self._commands.handle:
            taken = self._commands.handle.take_message(JointTrajectory, False)
        return taken and taken[0]


@pytest.fixture
def caller(graph):
    caller = Caller(graph, IdentifyPayload, "identify_payload")
    yield caller
    caller.close()


def test_every_cause_stops_the_arm_while_the_executor_is_blocked(graph, caller):
    blocked = BlockedNode(graph)
    stops = ReadyStops.judged(MOTION, lambda stop, _: "too hard" if stop.duration < 0.5 else "")
    graph.wait_for(lambda: blocked.watchdog.serves and caller._client.server_is_ready(), what="the action")
    codes = {
        "cancel": ErrorCode.CANCELLED,
        "silence": ErrorCode.SENSOR_STALE,
        "silence of the arm alone": ErrorCode.SENSOR_STALE,
        "force": ErrorCode.IN_CONTACT,
        "exception": ErrorCode.SOLVER_FAILED,
    }
    for cause, code in codes.items():
        handle, goal, arm = blocked.moving(caller, stops)
        if cause == "cancel":
            handle.cancel_goal_async()
        elif cause == "force":
            blocked.force = 50.0
        elif cause == "exception":
            arm.stop(PoiseError(code, "broken"), time.monotonic())
        silent = {"silence": "all", "silence of the arm alone": "arm"}.get(cause, "")
        stop = blocked.until(blocked.command, silent=silent)
        assert stop, cause
        np.testing.assert_allclose(stop.points[-1].velocities, 0.0, atol=1e-9)
        assert stop.header.stamp.sec > 0
        assert blocked.until(lambda: blocked.watchdog.sent), cause
        assert blocked.watchdog.sent.error.code is code
        with pytest.raises(PoiseError):
            arm.check()
        assert arm.stopped
        assert blocked.command() is None  # one stop for each motion
        with pytest.raises(PoiseError) as refused:
            arm.move(stops, time.monotonic())
        assert refused.value.code is code  # and no motion after it
        assert not arm.moving
        blocked.watchdog.rest()
        goal.abort()
        goal.execute(lambda _: IdentifyPayload.Result())
        graph.wait_for(handle.get_result_async().done, what="the result")
    blocked.watchdog.close()


def test_a_node_that_ends_leaves_a_stopped_arm_and_an_answered_goal_and_a_killed_watchdog_comes_back(graph, caller):
    blocked = BlockedNode(graph)
    stops = ReadyStops.judged(MOTION, lambda *_: "")
    graph.wait_for(lambda: blocked.watchdog.serves and caller._client.server_is_ready(), what="the action")
    _, _, arm = blocked.moving(caller, stops)
    os.kill(blocked.watchdog._process.pid, signal.SIGKILL)
    blocked.until(lambda: not blocked.watchdog.alive)
    with pytest.raises(PoiseError, match="watchdog of the motion has ended"):
        arm.check()
    graph.wait_for(lambda: blocked.watchdog.serves, what="another watchdog")
    assert not blocked.watchdog.alive  # it has no stop of this motion
    assert arm.stop(PoiseError(ErrorCode.INTERNAL, "no watchdog"), time.monotonic())  # by the node itself
    with pytest.raises(PoiseError, match="does not have the stops"):
        arm.move(stops, time.monotonic())
    blocked.watchdog.rest()
    caller.ready()
    handle, _, _ = blocked.moving(caller, stops)
    blocked.watchdog._closing = True
    blocked.watchdog._link.close()  # as the kernel does when a node is killed
    assert blocked.until(blocked.command)
    assert "start it and send the goal again" in caller.result(handle).result.error.message
    blocked.watchdog.close()


def test_a_watchdog_that_is_late_neither_stops_the_arm_again_nor_lets_it_move(graph, caller):
    blocked = BlockedNode(graph)
    stops = ReadyStops.judged(MOTION, lambda *_: "")
    graph.wait_for(lambda: blocked.watchdog.serves and caller._client.server_is_ready(), what="the action")
    handle, goal, arm = blocked.moving(caller, stops)
    process = blocked.watchdog._process.pid
    os.kill(process, signal.SIGSTOP)
    try:
        error = PoiseError(ErrorCode.SOLVER_FAILED, "broken")
        assert blocked.until(lambda: arm.stop(error, time.monotonic()))
        assert len(blocked.sent) == 2  # the motion, and the stop by the node itself
        handle.cancel_goal_async()
        with pytest.raises(PoiseError, match="did not answer"):
            arm.move(stops, time.monotonic())
        assert len(blocked.sent) == 2
    finally:
        os.kill(process, signal.SIGCONT)
    blocked.force = 50.0
    assert not blocked.until(blocked.command, 1.0)
    assert blocked.watchdog.sent is None
    with pytest.raises(PoiseError, match="cancelled"):  # between two motions
        arm.move(stops, time.monotonic())
    assert len(blocked.sent) == 2
    goal.abort()
    goal.execute(lambda _: IdentifyPayload.Result())
    graph.wait_for(handle.get_result_async().done, what="the result")
    blocked.watchdog.close()


def test_goals_that_would_wait_for_a_node_without_end_are_rejected():
    for waiting, answer in ((0, GoalResponse.ACCEPT), (31, GoalResponse.ACCEPT), (32, GoalResponse.REJECT)):
        process = SimpleNamespace(_open=True, _goals=dict.fromkeys(range(waiting)))
        assert WatchdogNode._on_request(process, None) is answer


def test_a_queued_link_sends_in_order_and_never_waits_for_the_reader():
    ours, its = socket.socketpair()
    link, other = QueuedLink(ours.detach()), WatchdogLink(its.detach())
    sender = threading.Thread(target=lambda: [link.send("word", bytes(1_000_000), number=i) for i in range(5)])
    sender.start()
    sender.join(30.0)
    assert not sender.is_alive()
    assert not link.idle
    assert [other.receive().values["number"] for _ in range(5)] == list(range(5))
    other.close()
