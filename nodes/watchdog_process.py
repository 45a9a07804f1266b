"""The process beside a node that moves an arm: it serves the node's action, and stops the arm by itself.

It computes nothing else, so that a cancel, a silent sensor or the end of the node stop the arm at once. The stops of a
motion are here, serialized, before the motion is sent.
"""

import contextlib
import importlib
import itertools
import os
import signal
import struct
import sys
import threading
import time
from dataclasses import dataclass
from typing import Any

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode, PoiseError
from poise.nodes.clock import follow_clock, node_seconds, with_time
from poise.nodes.motion_watch import MotionWatch, WatchLimits
from poise.nodes.responses import send_responses_again
from poise.nodes.runtime import EventsExecutor, to_message
from poise.nodes.watchdog_link import QueuedLink, SharedNumber, Word

_LOOK = 0.004
"""s between two looks at a motion, and least time between two joint states that are read."""
_ALIVE = 0.1
"""s between two signs of life while an arm moves."""
_FAREWELL = 0.3
"""s for the last results to leave."""
_STEP = 0.2
_PRIORITY, _NICE = 10, -10
"""Of this process, in real time or else among the others; controllers of ros2_control have 50."""
_BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Matches every publisher; a lost joint state is no harm here."""
_STAMP = struct.Struct("<iI")
_STAMP_AT = 4
"""Bytes before the stamp of a serialized message that begins with a header."""
_FORCE = struct.Struct("<3d")
_WRENCH_BYTES = 48
"""At the end of a serialized WrenchStamped."""
_MOST_GOALS = 32
"""Goals that may wait for the node; the node answers those that it cannot take at once."""


@dataclass(frozen=True)
class LoadedMotion:
    """The stops of a motion.

    Args:
        begins: s of the motion at which they begin.
        fastest: (J,) largest planned speed of each joint.
        excess: by index of the stop, the limits that it exceeds.
        messages: the serialized stops.
    """

    begins: list[float]
    fastest: list[float]
    excess: dict[int, str]
    messages: list[bytes]

    @classmethod
    def of(cls, word: Word) -> "LoadedMotion":
        """From a message `load`."""
        ends = [0]
        for size in word.values["sizes"]:
            ends.append(ends[-1] + size)
        messages = [word.body[a:b] for a, b in itertools.pairwise(ends)]
        excess = {int(key): text for key, text in word.values["excess"].items()}
        return cls(word.values["begins"], word.values["fastest"], excess, messages)


class WatchdogNode(Node):
    """Serves one action for another process, and publishes the stops of its motions.

    Args:
        link: to that process.
        setup: names of node, namespace, action and topics.
        armed: number of the motion that this process may stop; 0: none.
    """

    def __init__(self, link: QueuedLink, setup: dict[str, Any], armed: SharedNumber) -> None:
        super().__init__(setup["node"], namespace=setup["namespace"], parameter_overrides=with_time(setup["simulated"]))
        follow_clock(self)
        self._link, self._setup, self._armed = link, setup, armed
        self.ended = False
        """The node that started this process is gone."""
        self._lock, self._watching = threading.RLock(), threading.Event()
        self._watch: MotionWatch | None = None
        self._motions: dict[int, LoadedMotion] = {}
        self._motion: LoadedMotion | None = None
        self._moving_for, self._number = "", 0
        self._barred: dict[str, PoiseError] = {}
        """Goals that were stopped or cancelled: they get no further motion."""
        self._open, self._ending, self._hearing = setup["open"], False, False
        self._read = self._said = 0.0
        self._listening: list[Any] = []
        self._goals: dict[str, ServerGoalHandle] = {}
        self._arm = self.create_publisher(JointTrajectory, setup["joint_trajectory"], 10)
        package, _, name = setup["action"]
        self._kind = getattr(importlib.import_module(f"{package}.action"), name)
        self._server = ActionServer(
            self,
            self._kind,
            setup["action_name"],
            lambda goal: self._kind.Result(),
            goal_callback=self._on_request,
            handle_accepted_callback=self._on_goal,
            cancel_callback=self._on_cancel,
        )
        link.send("ready")

    # -- of the action, in the executor --------------------------------------------------------------------------

    def _on_request(self, _: Any) -> GoalResponse:
        return GoalResponse.ACCEPT if self._open and len(self._goals) < _MOST_GOALS else GoalResponse.REJECT

    def _on_goal(self, goal: ServerGoalHandle) -> None:
        key = bytes(goal.goal_id.uuid).hex()
        self._goals[key] = goal
        if self._ending:
            self._conclude(key, "aborted", self._farewell())
        else:
            self._link.send("goal", serialize_message(goal.request), goal=key)

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        key = bytes(goal.goal_id.uuid).hex()
        error = PoiseError(ErrorCode.CANCELLED, "the goal was cancelled")
        with self._lock:
            self._barred.setdefault(key, error)
            if key == self._moving_for:
                self._try_to_stop(error)
        if not goal.is_cancel_requested:
            self._link.send("cancel", goal=key)
        return CancelResponse.ACCEPT

    def _conclude(self, key: str, status: str, result: Any) -> None:
        """End a goal; its status follows from whether a cancel was asked for by now."""
        self._barred.pop(key, None)
        goal = self._goals.pop(key, None)
        if goal is None:
            return

        def end(handle: ServerGoalHandle) -> Any:
            if status == "succeeded":
                handle.succeed()
            elif handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            return result

        goal.execute(end)

    # -- of the motion --------------------------------------------------------------------------------------------

    def stop(self, error: PoiseError) -> None:
        """Send the stop that is ready, once for each motion, and report it."""
        with self._lock:
            watch, motion = self._watch, self._motion
            if watch is None or motion is None or not watch.armed:
                return
            if self._armed.value != self._number:  # it ended, or its node has stopped it, while this process was late
                watch.disarm()
                return
            chosen = watch.stop(node_seconds())
            message = bytearray(motion.messages[chosen.number])
            _STAMP.pack_into(message, _STAMP_AT, *divmod(chosen.stamp, 10**9))
            self._arm.publish(bytes(message))
            watch.disarm()
            self._barred[self._moving_for] = error
            excess = motion.excess.get(chosen.number, "")
            self._link.send("sent", goal=self._moving_for, code=int(error.code), message=error.message, excess=excess)

    def look(self) -> None:
        """Check the motion, for a thread of its own."""
        while not self._ending:
            watch = self._watch
            if watch is None:
                self._watching.wait(_STEP)
                continue
            time.sleep(_LOOK)
            with self._lock:
                problem = watch.problem(node_seconds())
            if problem is not None:
                self._try_to_stop(problem)
            if watch.armed and node_seconds() > self._said + _ALIVE and self._link.idle:
                self._said = node_seconds()
                self._link.send("alive")

    def _try_to_stop(self, error: PoiseError) -> None:
        try:
            self.stop(error)
        except Exception as failure:  # the next look tries again
            self.get_logger().error(f"the stop could not be sent: {failure!r}", throttle_duration_sec=1.0)

    def _on_joint_state(self, data: bytes) -> None:
        now = node_seconds()
        with self._lock:
            watch = self._watch
            if watch is None:
                return
            if watch.ready and now - self._read < _LOOK:
                return
            message = deserialize_message(data, JointState)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            if watch.joint_state(stamp, dict(zip(message.name, message.position, strict=False)), now):
                self._read = now
        self._report_hearing(watch)

    def _on_wrench(self, data: bytes) -> None:
        with self._lock:
            watch = self._watch
            if watch is None:
                return
            watch.wrench(_FORCE.unpack_from(data, len(data) - _WRENCH_BYTES), node_seconds())
        self._report_hearing(watch)

    def _report_hearing(self, watch: MotionWatch) -> None:
        if watch.ready and not self._hearing:
            self._hearing = True
            self._link.send("hearing")

    # -- of the node, in the thread that receives -------------------------------------------------------------------

    def obey(self) -> None:
        """Do what the node says until it is gone; then stop the arm, end its goals, and end."""
        while (word := self._link.receive()) is not None:
            try:
                getattr(self, f"_do_{word.what}")(word)
            except Exception as failure:
                self.get_logger().error(f"{word.what}: {failure!r}", throttle_duration_sec=1.0)
        with contextlib.suppress(Exception):
            self.stop(PoiseError(ErrorCode.INTERNAL, "the program has ended"))
        self._ending = True
        for key in list(self._goals):
            self._conclude(key, "aborted", self._farewell())
        time.sleep(_FAREWELL)
        self.ended = True
        time.sleep(_FAREWELL + _STEP)  # the context did not shut down by then
        os._exit(0)

    def _do_open(self, word: Word) -> None:
        self._open = word.values["open"]

    def _do_watch(self, word: Word) -> None:
        with self._lock:
            limits = WatchLimits(**word.values["limits"])
            self._watch, self._hearing = MotionWatch(word.values["names"], limits, node_seconds()), False
            self._motions.clear()
        self._watching.set()
        if self._listening:
            return
        topics: list[tuple[Any, str, Any]] = [(JointState, "joint_states", self._on_joint_state)]
        if limits.wrenches:
            topics.append((WrenchStamped, "wrench", self._on_wrench))
        self._listening = [
            self.create_subscription(kind, self._setup[topic], take, _BEST_EFFORT, raw=True)
            for kind, topic, take in topics
        ]

    def _do_rest(self, _: Word) -> None:
        with self._lock:
            self._watch = self._motion = None
            self._moving_for = ""
            self._motions.clear()
        self._watching.clear()
        for subscription in self._listening:
            self.destroy_subscription(subscription)
        self._listening = []

    def _do_load(self, word: Word) -> None:
        self._motions[word.values["key"]] = LoadedMotion.of(word)

    def _do_arm(self, word: Word) -> None:
        number, goal = word.values["number"], word.values["goal"]
        with self._lock:
            watch, motion, error = self._watch, self._motions.get(word.values["key"]), self._barred.get(goal)
            if error is not None or watch is None or motion is None or self._armed.value != number:
                error = error or PoiseError(ErrorCode.INTERNAL, "the watchdog does not have the stops of this motion")
                self._link.send("refused", number=number, code=int(error.code), message=error.message)
                return
            self._motion, self._moving_for, self._number = motion, goal, number
            watch.arm(motion.begins, motion.fastest, word.values["begin"], node_seconds())
        self._said = node_seconds()
        self._link.send("armed", number=number)

    def _do_beat(self, _: Word) -> None:
        if self._watch is not None:
            self._watch.beat(node_seconds())

    def _do_trip(self, word: Word) -> None:
        self.stop(PoiseError(ErrorCode(word.values["code"]), word.values["message"]))

    def _do_disarm(self, _: Word) -> None:
        with self._lock:
            if self._watch is not None:
                self._watch.disarm()

    def _do_feedback(self, word: Word) -> None:
        goal = self._goals.get(word.values["goal"])
        if goal is not None:
            goal.publish_feedback(deserialize_message(word.body, self._kind.Feedback))

    def _do_result(self, word: Word) -> None:
        self._conclude(word.values["goal"], word.values["status"], deserialize_message(word.body, self._kind.Result))

    def _farewell(self) -> Any:
        error = PoiseError(ErrorCode.INTERNAL, f"{self._setup['owner']} has ended; start it and send the goal again")
        return self._kind.Result(error=to_message(error))


def before_others() -> None:
    """Run before the other programs of a loaded machine, as controllers do, where the user may (limits `rtprio`)."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_PRIORITY))
    except OSError:
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, _NICE)


def main() -> None:
    """Run beside the node that started this process; the arguments are descriptors of a socket and of memory."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # it ends when the node has ended
    before_others()
    link, armed = QueuedLink(int(sys.argv[1])), SharedNumber(int(sys.argv[2]))
    setup = link.receive()
    if setup is None:
        return
    rclpy.init(
        args=setup.values["arguments"],
        domain_id=setup.values["domain"],
        signal_handler_options=rclpy.SignalHandlerOptions.NO,
    )
    node = WatchdogNode(link, setup.values, armed)
    send_responses_again()
    executor = EventsExecutor()
    executor.add_node(node)
    for work in (node.look, node.obey):
        threading.Thread(target=work, daemon=True).start()
    while not node.ended:
        with contextlib.suppress(Exception):
            executor.spin_once(timeout_sec=_STEP)
    rclpy.try_shutdown()  # the others of the graph see it leave
    os._exit(0)


if __name__ == "__main__":
    main()
