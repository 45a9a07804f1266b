"""The side of a node of its watchdog process: goals that come from it, and the stops of motions that it has ready."""

import itertools
import socket
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from poise.errors import ErrorCode, PoiseError
from poise.excitation import joint_peaks
from poise.excitation.execution import ExecutionOptions, ReadyStops, SentStop
from poise.nodes.clock import node_seconds, simulates_time
from poise.nodes.motion_watch import WatchLimits
from poise.nodes.parameters import Parameter
from poise.nodes.runtime import guarded
from poise.nodes.trajectory_message import trajectory_message
from poise.nodes.watchdog_link import SharedNumber, WatchdogLink, Word

WATCHDOG_PARAMETERS = (
    Parameter("stop_silence", 0.5, "s without joint states (or wrenches) that stop a motion", (0.02, 10.0)),
    Parameter("motion_lead", 0.15, "s between sending a motion and its begin; it has to arrive by then", (0.02, 5.0)),
    Parameter("stop_unattended", 5.0, "s that this node may be held up before a motion is stopped", (0.1, 60.0)),
    Parameter("stop_over_speed", 1.5, "a motion stops above this multiple of a joint's planned speed", (1.05, 100.0)),
    Parameter(
        "stop_force",
        0.0,
        "N of change of the force on topic wrench (then needed) that stop a motion; 0: none",
        (0.0, 1e5),
    ),
)
WATCHDOG_DYNAMIC = tuple(parameter.name for parameter in WATCHDOG_PARAMETERS)
"""All may be changed; they count from the next goal on."""
_LOST = 0.5
"""s without a sign of life after which a watchdog with a moving arm counts as lost."""
_HELD_UP = 0.1
"""s between two looks that show that this process was held up."""
_ARMING = 0.1
"""s that a watchdog may take to arm; the motion is sent after that, and before it begins."""
_MOMENT = 0.01
"""s between looks for the executor of a node that is still being made."""
_AGAIN = 1.0
"""s between two starts of the process."""
_PATIENCE = struct.pack("ll", 0, 500_000)
"""s and us that a process may not take what it is sent."""
_END = 1.0
"""s that the process may take to end."""


class WatchedGoal:
    """A goal of the action, as `rclpy.action.server.ServerGoalHandle`, that the watchdog's process serves."""

    def __init__(self, key: str, request: Any, send: Callable[..., None]) -> None:
        self.key, self.request, self._send = key, request, send
        self.is_cancel_requested = False
        self._status = "aborted"

    def publish_feedback(self, feedback: Any) -> None:
        """Send a feedback message; a watchdog that is gone gets none."""
        self._send("feedback", serialize_message(feedback), goal=self.key)

    def execute(self, conclude: Callable[["WatchedGoal"], Any]) -> None:
        """Let `conclude` set the status and give the result."""
        self._send("result", serialize_message(conclude(self)), goal=self.key, status=self._status)

    def succeed(self) -> None:
        """Set the status."""
        self._status = "succeeded"

    def abort(self) -> None:
        """Set the status."""
        self._status = "aborted"

    def canceled(self) -> None:
        """Set the status."""
        self._status = "canceled"


class ProcessWatchdog:
    """A process that serves an action and stops the arm, also while this process is busy (`watchdog_process`).

    It is started again when it ends. Implements `poise.excitation.execution.Watchdog`.

    Args:
        node: whose action it is.
        action: its type. name: of the action.
        accept: takes each goal, in the executor of the node.
    """

    def __init__(self, node: Node, action: Any, name: str, accept: Callable[[WatchedGoal], None]) -> None:
        self._node, self._action, self._accept = node, action, guarded(node, accept)
        self._setup = {
            "owner": node.get_name(),
            "node": f"{node.get_name()}_watchdog",
            "namespace": node.get_namespace(),
            "action": ("poise_msgs", "action", action.__name__),
            "action_name": node.resolve_service_name(name),
            "arguments": _enclave(sys.argv),
            "domain": node.context.get_domain_id(),
            "simulated": simulates_time(node),
            **{topic: node.resolve_topic_name(topic) for topic in ("joint_trajectory", "joint_states", "wrench")},
        }
        self._keys = itertools.count(1)
        self._link: WatchdogLink | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._closing = self._open = self._up = self._hearing = False
        self._armed = self._confirmed = 0  # number of a motion: ours, and the one that the process answered for
        self._may_stop, self._answered = SharedNumber(), threading.Event()
        self._refusal: PoiseError | None = None
        self._said = self._looked = 0.0
        self._goals: dict[str, WatchedGoal] = {}
        self._current = ""
        self._loaded: dict[int, tuple[int, ReadyStops]] = {}
        self._names: tuple[str, ...] = ()
        self._sent: SentStop | None = None
        self._heard: deque[Word] = deque()
        self._take_words = guarded(node, self._take)
        self._thread = threading.Thread(target=self._serve, name="watchdog", daemon=True)
        self._thread.start()

    # -- goals ------------------------------------------------------------------------------------------------------

    def open(self, yes: bool = True) -> None:
        """Accept goals, or reject them."""
        self._open = yes
        self._say("open", open=yes)

    @property
    def serves(self) -> bool:
        """The process is there, and its action can be called."""
        return self._up

    def _take(self) -> None:
        while self._heard:
            word = self._heard.popleft()
            key = word.values["goal"]
            if word.what == "cancel":
                if key in self._goals:
                    self._goals[key].is_cancel_requested = True
                continue
            goal = WatchedGoal(key, deserialize_message(word.body, self._action.Goal), self._send_for_goal)
            self._goals[key] = goal
            self._accept(goal)

    def _send_for_goal(self, what: str, body: bytes, **values: Any) -> None:
        if what == "result":
            self._goals.pop(values["goal"], None)
        self._say(what, body, **values)

    # -- a motion ---------------------------------------------------------------------------------------------------

    def watch(self, goal: WatchedGoal, names: tuple[str, ...], limits: WatchLimits) -> None:
        """Listen to the robot for a goal, until `rest`."""
        self._current, self._names, self._hearing, self._sent = goal.key, names, False, None
        self._loaded.clear()
        self._say("watch", names=list(names), limits=asdict(limits))

    def rest(self) -> None:
        """The goal has ended."""
        self._armed = self._may_stop.value = 0
        self._loaded.clear()
        self._say("rest")

    @property
    def ready(self) -> bool:
        """It hears what it needs, and may be given a motion."""
        return self._up and self._hearing

    @property
    def alive(self) -> bool:
        """It can still stop the motion."""
        now = node_seconds()
        if now - self._looked > _HELD_UP:  # what it said may wait to be read
            self._said = max(self._said, now - _LOST + _HELD_UP)
        self._looked = now
        return self._up and (not self._armed or (self._confirmed == self._armed and now - self._said < _LOST))

    @property
    def sent(self) -> SentStop | None:
        """The stop of a motion of this goal, once it has been sent; no other motion may follow."""
        return self._sent

    def load(self, stops: ReadyStops) -> None:
        """Serialize the stops of a motion and hand them over; for worker threads."""
        key = next(self._keys)
        messages = [serialize_message(trajectory_message(self._names, stop.motion)) for stop in stops.stops]
        rate, _ = joint_peaks(stops.motion)
        self._say(
            "load",
            b"".join(messages),
            key=key,
            begins=[stop.begin for stop in stops.stops],
            fastest=rate.tolist(),
            sizes=[len(message) for message in messages],
            excess={index: stop.excess for index, stop in enumerate(stops.stops) if stop.excess},
        )
        self._loaded[id(stops)] = key, stops  # kept, so that no other has its id

    def arm(self, stops: ReadyStops, begin: int) -> bool:
        """The motion of these stops begins at `begin` ns; False: the process did not answer within 0.1 s.

        Raises:
            PoiseError: the goal was stopped or cancelled; INTERNAL when the process does not have its stops.
        """
        if self._sent is not None:
            raise self._sent.error
        loaded = self._loaded.get(id(stops))
        if not self._up or loaded is None:
            raise PoiseError(ErrorCode.INTERNAL, "the watchdog does not have the stops of this motion")
        self._answered.clear()
        self._refusal, self._said = None, node_seconds()
        self._armed = self._may_stop.value = number = next(self._keys)
        self._say("arm", key=loaded[0], number=number, begin=begin, goal=self._current)
        self._answered.wait(_ARMING)
        if self._confirmed != number:
            self.disarm()
        if self._refusal is not None:
            raise self._refusal
        return self._confirmed == number

    def beat(self) -> None:
        """This process is alive."""
        self._say("beat")

    def trip(self, error: PoiseError) -> bool:
        """Have the stop sent at once; False: there is no process."""
        self._say("trip", code=int(error.code), message=error.message)
        return self._up

    def disarm(self) -> None:
        """The motion has ended, or was stopped; the process sends no stop from here on, also when it is late."""
        self._armed = self._may_stop.value = 0
        self._say("disarm")

    # -- the process ------------------------------------------------------------------------------------------------

    def close(self) -> None:
        """End the process; it stops the arm and ends the goals that are left."""
        self._closing = True
        if self._link is not None:
            self._link.close()
        process = self._process
        if process is not None:
            try:
                process.wait(_END)
            except subprocess.TimeoutExpired:
                process.kill()
        self._thread.join(_END)

    def _serve(self) -> None:
        """Start the process, take what it says, and start it again when it has ended."""
        while not self._closing:
            ours, its = socket.socketpair()
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _PATIENCE)
            shared = [its.fileno(), self._may_stop.descriptor]
            with its:
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-m", "poise.nodes.watchdog_process", *map(str, shared)],
                    pass_fds=shared,
                    stdin=subprocess.DEVNULL,
                    start_new_session=True,  # it ends after its node, not with it by Ctrl-C
                )
            self._link = link = WatchdogLink(ours.detach())
            self._say("setup", open=self._open, **self._setup)
            while (word := link.receive()) is not None:
                self._said = node_seconds()
                self._hear(word)
            self._up = self._hearing = False
            self._confirmed = 0
            self._loaded.clear()
            self._goals.clear()
            link.close()
            if not self._closing:
                self._process.kill()
                self._process.wait()
            if not self._closing and rclpy.ok():
                self._node.get_logger().error("the watchdog process has ended; it is started again")
                time.sleep(_AGAIN)

    def _hear(self, word: Word) -> None:
        if word.what == "ready":
            self._up = True
            self._node.get_logger().info(f"{self._setup['action_name']} takes goals")
        elif word.what == "hearing":
            self._hearing = True
        elif word.what == "armed" and word.values["number"] == self._armed:
            self._confirmed = word.values["number"]
            self._answered.set()
        elif word.what == "refused" and word.values["number"] == self._armed:
            self._refusal = _error_of(word)
            self._answered.set()
        elif word.what == "sent" and word.values["goal"] == self._current:
            self._sent = SentStop(_error_of(word), word.values["excess"])
        elif word.what in ("goal", "cancel"):
            self._heard.append(word)
            while self._node.executor is None and not self._closing:  # the node is still being made
                time.sleep(_MOMENT)
            if self._node.executor is not None:  # the events executor takes no guard conditions
                self._node.executor.create_task(self._take_words)

    def _say(self, what: str, body: bytes = b"", **values: Any) -> None:
        if self._link is not None:
            try:
                self._link.send(what, body, **values)
            except OSError:  # it has ended, or takes nothing any more
                self._link.close()


def _error_of(word: Word) -> PoiseError:
    return PoiseError(ErrorCode(word.values["code"]), word.values["message"])


def watch_limits(node: Node, needs_wrench: bool = False) -> WatchLimits:
    """What the parameters say now."""
    value = {name: node.get_parameter(name).value for name in WATCHDOG_DYNAMIC}
    return WatchLimits(
        silence=value["stop_silence"],
        unattended=value["stop_unattended"],
        over_speed=value["stop_over_speed"],
        force=value["stop_force"],
        needs_wrench=needs_wrench,
    )


def execution_options(node: Node) -> ExecutionOptions:
    """What the parameters say now, `ready_timeout` included; an arm always has some time to be heard and to rest."""
    names = ("stop_silence", "motion_lead", "ready_timeout")
    silence, lead, ready = (node.get_parameter(name).value for name in names)
    return ExecutionOptions(stale=silence, lead=lead, patience=max(ready, ExecutionOptions.patience))


def _enclave(arguments: list[str]) -> list[str]:
    """The security enclave among the arguments of a program: its watchdog has the same one."""
    if "--enclave" not in arguments[:-1]:
        return []
    return ["--ros-args", "--enclave", arguments[arguments.index("--enclave") + 1]]
