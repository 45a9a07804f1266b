"""From a cause to the stop command while the node computes: `python -m benchmarks.stop_latency [--quick]`.

A node plans with 3,001 guarded points in its executor, which is blocked all the time; busy processes load every core.
The robot of this benchmark cancels, falls silent, moves too fast, pushes too hard, or kills the node, and takes the
time until the stop is on `joint_trajectory`; of a killed node, from its end on. "In the executor" is the same without
the watchdog process: a timer of the node would see the cause as soon as its computation ends.
"""

import argparse
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rich.console import Console
from rich.table import Table
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from poise.errors import ErrorCode, PoiseError
from poise.excitation import Guard, MotionLimits, tool_centre
from poise.excitation.execution import ReadyStops, brake
from poise.nodes.arm_node import ArmNode
from poise.nodes.motion_watch import WatchLimits
from poise.nodes.runtime import run, to_message
from poise.nodes.trajectory_message import trajectory_message
from poise.nodes.watchdog import ProcessWatchdog, WatchedGoal
from poise.nodes.watchdog_process import before_others
from poise.robot import RobotModel
from poise.simulation import WaypointTrajectory, home
from poise_msgs.action import IdentifyPayload

CAUSES = ("cancel", "silence", "over-force", "over-speed", "exception", "executor hangs", "node ended")
POINTS = 3001
SILENCE, UNATTENDED, FORCE = 0.3, 0.3, 20.0
PERIOD = 0.008
"""s between joint states: 125 Hz."""
RARE = 100
"""Trials of which one kills the node, which then has to start again."""
BLOCKED = 0.9
"""s that the executor computes, in each trial."""
console = Console(width=110)


class BusyNode(ArmNode):
    """Sends a motion for each goal, and then computes in its executor without a break."""

    def __init__(self) -> None:
        super().__init__("busy_arm")
        self._model = model = RobotModel.from_file("fr3")
        points = np.random.default_rng(0).normal(size=(POINTS, 3))
        points = 0.12 * points / np.linalg.norm(points, axis=1)[:, None]
        self._guard = Guard(np.vstack([tool_centre(model, "tcp"), points[1:]]))
        begin = home(model)
        self._motion = WaypointTrajectory(np.array([0.0, 2.0]), np.stack([begin, begin + 0.1]))
        self._stops = ReadyStops.prepare(model, self._motion, self._guard, MotionLimits())
        self._arm = self.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self._goal: WatchedGoal | None = None
        self.create_timer(0.01, self._work)
        self.watchdog = ProcessWatchdog(self, IdentifyPayload, "identify_payload", self._take)
        self.start()

    def _take(self, goal: WatchedGoal) -> None:
        hangs = goal.request.method == "executor hangs"
        limits = WatchLimits(SILENCE, UNATTENDED if hangs else 10.0, force=FORCE, needs_wrench=True)
        self.watchdog.watch(goal, self._model.joint_names, limits)
        self._goal = goal

    def _work(self) -> None:
        goal = self._goal
        if goal is None or not self.watchdog.ready:
            return
        self._goal = None
        self.watchdog.load(self._stops)
        begun, failed = time.monotonic(), 0.0
        while not self.watchdog.arm(self._stops, time.time_ns()):
            continue
        self._arm.publish(trajectory_message(self._model.joint_names, self._motion, time.time_ns()))
        while time.monotonic() < begun + BLOCKED:
            brake(self._model, self._motion, 1.0, self._guard, MotionLimits())
            if goal.request.method == "exception" and not failed and time.monotonic() > begun + 0.1:
                failed = time.monotonic()
                self.watchdog.trip(PoiseError(ErrorCode.INTERNAL, "an exception"))
        since = failed or (begun if goal.request.method == "executor hangs" else 0.0)
        self.watchdog.rest()
        goal.succeed()
        result = IdentifyPayload.Result(error=to_message(PoiseError(ErrorCode.OK, repr(since))))
        goal.execute(lambda _: result)


class Robot:
    """Publishes joint states and wrenches, causes trouble, and takes the time of each command."""

    def __init__(self) -> None:
        self._node = rclpy.create_node("busy_robot")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        model = RobotModel.from_file("fr3")
        self._names, self._place = list(model.joint_names), home(model)
        self._states = self._node.create_publisher(JointState, "joint_states", 10)
        self._wrenches = self._node.create_publisher(WrenchStamped, "wrench", 10)
        self.arrived: list[float] = []
        self._node.create_subscription(JointTrajectory, "joint_trajectory", self._note, 10)
        self._client = ActionClient(self._node, IdentifyPayload, "identify_payload")
        self._spoke = 0.0
        self.push, self.run_away, self.silent = 0.0, 0.0, False

    def _note(self, _: JointTrajectory) -> None:
        self.arrived.append(time.monotonic())

    def until(self, condition: Callable[[], bool], seconds: float = 60.0) -> bool:
        """Play the robot until a condition holds; whether it does."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            now = time.monotonic()
            if not self.silent and now > self._spoke + PERIOD:
                self._spoke = now
                self._speak()
            self._executor.spin_once(timeout_sec=0.001)
        return condition()

    def _speak(self) -> None:
        stamp = self._node.get_clock().now().to_msg()
        state = JointState(name=self._names, position=(self._place + self.run_away).tolist())
        wrench = WrenchStamped()
        state.header.stamp = wrench.header.stamp = stamp
        wrench.wrench.force.z = self.push
        self._wrenches.publish(wrench)
        self._states.publish(state)

    def trial(self, cause: str, rng: np.random.Generator, node: "subprocess.Popen[bytes]") -> float:
        """s from the cause to the stop; NaN: there was no stop."""
        self.arrived.clear()
        self.push, self.run_away, self.silent = 0.0, 0.0, False
        for _ in range(20):  # a node that was killed is not forgotten at once
            self.until(self._client.server_is_ready)
            sent = self._client.send_goal_async(IdentifyPayload.Goal(method=cause))
            if self.until(sent.done, 3.0) and sent.result().accepted:
                break
        result = sent.result().get_result_async()
        if not self.until(lambda: len(self.arrived) == 1):
            return np.nan
        self.until(lambda: False, rng.uniform(0.03, 0.15))
        since = self._cause(cause, sent.result(), node)
        self.until(lambda: len(self.arrived) > 1, 2.0)
        self.silent = False
        if cause != "node ended":
            self.until(result.done)
        if cause in ("exception", "executor hangs"):
            since = float(result.result().result.error.message)
            since += UNATTENDED if cause == "executor hangs" else 0.0
        return self.arrived[1] - since if len(self.arrived) > 1 else np.nan

    def _cause(self, cause: str, handle: object, node: "subprocess.Popen[bytes]") -> float:
        since = time.monotonic()
        if cause == "cancel":
            handle.cancel_goal_async()
        elif cause == "silence":
            self.silent = True
            since = self._spoke + SILENCE
        elif cause == "over-force":
            self.push = 2 * FORCE
            self._spoke = since
            self._speak()
        elif cause == "over-speed":
            self.run_away = 0.2
            before = self._spoke
            self.until(lambda: self._spoke > before)  # only the next joint state can show it
            since = self._spoke
        elif cause == "node ended":
            os.kill(node.pid, signal.SIGKILL)
            node.wait()
            since = time.monotonic()
        return since


def burn() -> None:
    """Keep a core busy."""
    while True:
        sum(range(100_000))


def trials(count: int, only: str | None = None) -> Iterator[tuple[str, float]]:
    """A cause, each in turn or one alone, and the time until its stop, s."""
    rng = np.random.default_rng(0)
    start = ["chrt", "--other", "0", sys.executable, "-m", "benchmarks.stop_latency", "--node"]
    robot, node = Robot(), subprocess.Popen(start)
    try:
        for number in range(count):
            cause = only or (CAUSES[-1] if number % RARE == RARE - 1 else CAUSES[number % (len(CAUSES) - 1)])
            yield cause, robot.trial(cause, rng, node)
            if cause == "node ended":
                node.wait()
                robot.until(lambda: False, 1.0)
                node = subprocess.Popen(start)
                robot.until(lambda: False, 1.0)
    finally:
        node.kill()


def blocked(count: int) -> list[float]:
    """s that a timer waits for an executor that is certifying stops, at random times."""
    model = RobotModel.from_file("fr3")
    begin = home(model)
    guard = Guard(np.random.default_rng(0).normal(size=(POINTS, 3)) * 0.1)
    motion = WaypointTrajectory(np.array([0.0, 2.0]), np.stack([begin, begin + 0.1]))
    found = []
    for _ in range(count):
        began = time.monotonic()
        ReadyStops.prepare(model, motion, guard, MotionLimits())
        found.append(time.monotonic() - began)
    return [float(one) for one in np.random.default_rng(0).uniform(0, 1, count) * np.array(found)]


def report(found: dict[str, list[float]], rival: list[float]) -> Table:
    """ms by cause."""
    table = Table(title=f"From cause to stop command, ms ({POINTS:,} guarded points, busy executor, loaded cores)")
    for name in ("cause", "trials", "no stop", "median", "99 %", "worst"):
        table.add_column(name, justify="right")
    rows = [*found.items(), ("all", [one for every in found.values() for one in every]), ("in the executor", rival)]
    for name, every in rows:
        kept = 1e3 * np.array([one for one in every if np.isfinite(one)] or [np.nan])
        numbers = (np.median(kept), np.percentile(kept, 99), kept.max())
        table.add_row(name, str(len(every)), str(sum(map(np.isnan, every))), *(f"{one:.1f}" for one in numbers))
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="100 trials")
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--cause", choices=CAUSES, help="this one alone")
    parser.add_argument("--verbose", action="store_true", help="print each trial")
    parser.add_argument("--node", action="store_true", help="be the node")
    arguments = parser.parse_args()
    if arguments.node:
        run(BusyNode, [])
        return
    rclpy.init(signal_handler_options=rclpy.SignalHandlerOptions.NO)
    burners = [multiprocessing.Process(target=burn, daemon=True) for _ in range(os.cpu_count() or 1)]
    for one in burners:
        one.start()
    before_others()  # or the clock of this benchmark would be late itself
    found: dict[str, list[float]] = defaultdict(list)
    for cause, seconds in trials(100 if arguments.quick else arguments.trials, arguments.cause):
        found[cause].append(seconds)
        if arguments.verbose:
            console.print(f"{cause}: {1e3 * seconds:.1f} ms")
    console.print(report(found, blocked(2 if arguments.quick else 10)))
    for one in burners:
        one.kill()


if __name__ == "__main__":
    main()
