"""The time of a node: that of the machine or, with the parameter use_sim_time, simulated time, heard on /clock."""

import time

from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from std_msgs.msg import Header

from poise.errors import ErrorCode

CLOCK_HEARD = "clock_heard"
"""Topic on which a node that follows /clock says how far it has come: stamp, and its name as frame_id."""
STEADY = Clock(clock_type=ClockType.STEADY_TIME)
"""For timers of what belongs to the machine: the time limit of a computation, whether a process is alive."""
CLOCK_SAID = 100_000_000
"""ns of simulated time between two messages on clock_heard."""
_PATIENCE = 10.0
"""s of the machine without /clock after which the time of the node goes on by itself."""
_FIRST_PATIENCE = 60.0
"""The same before the first /clock: simulators take long to start."""
_LOOK = 0.2
"""s of the machine between two looks at that."""
_NANO = 1e-9


class SimulatedTime:
    """The time of a node that follows /clock. It does not go back.

    It does not stop for good either: when /clock does, it goes on with the time of the machine, and so do the node's
    timers. Whatever waits for the world then ends with the error that it has for that, such as SENSOR_STALE.

    Args:
        node: with use_sim_time.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._clock = node, node.get_clock()
        self.seconds = time.monotonic()
        """Of simulated time; the origin means nothing. One assignment: any thread may read it."""
        self._heard = self._looked = self.seconds
        self._begun = self._alone = self._ours = False
        self._said = 0
        self._outlet = node.create_publisher(Header, CLOCK_HEARD, 10)
        each = JumpThreshold(
            min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1), on_clock_change=False
        )
        self._jumps = self._clock.create_jump_callback(each, post_callback=self._changed)
        node.create_timer(_LOOK, self._look, clock=STEADY)

    def _changed(self, jump: TimeJump) -> None:
        """The time was set, by /clock or by `_look`."""
        if self._begun or self._ours:  # else it is the first time of all
            self.seconds += max(jump.delta.nanoseconds, 0) * _NANO
        if self._ours:
            return
        self._begun, self._heard = True, time.monotonic()
        if self._alone:
            self._alone = False
            self._node.get_logger().info("/clock is back")
        now = self._clock.now()
        if abs(now.nanoseconds - self._said) >= CLOCK_SAID:
            self._said = now.nanoseconds
            self._outlet.publish(Header(stamp=now.to_msg(), frame_id=self._node.get_fully_qualified_name()))

    def _look(self) -> None:
        before, self._looked = self._looked, time.monotonic()
        patience = _PATIENCE if self._begun else _FIRST_PATIENCE
        if self._looked - self._heard < patience:
            return
        if not self._alone:
            self._alone = True
            still = f"/clock has not advanced for {patience:g} s"
            what = f"{still}: start or resume the simulator, or set use_sim_time to false"
            self._node.get_logger().error(f"{ErrorCode.SENSOR_STALE.name}: {what}; the node's time goes on without it")
        self._ours = True
        try:
            passed = round((self._looked - before) / _NANO)
            there = Time(nanoseconds=self._clock.now().nanoseconds + passed, clock_type=ClockType.ROS_TIME)
            self._clock.set_ros_time_override(there)
        finally:
            self._ours = False


_simulated: SimulatedTime | None = None


def follow_clock(node: Node) -> None:
    """Take the time of this process from /clock, if its node has use_sim_time; a process has one node."""
    global _simulated
    _simulated = SimulatedTime(node) if simulates_time(node) else None


def simulates_time(node: Node) -> bool:
    """Whether a node has use_sim_time."""
    return bool(node.get_parameter("use_sim_time").value)


def with_time(simulated: bool) -> list[Parameter]:
    """The parameters with which a node is made that does, or does not, follow /clock."""
    return [Parameter("use_sim_time", value=simulated)]


def node_seconds() -> float:
    """s of the time in which sensors, motions and goals of this process live; monotonic, of no known origin.

    That is simulated time where `follow_clock` took it, else `time.monotonic`. The time limit of a computation, and
    whether a process is alive, belong to the machine: there, use `time.monotonic`.
    """
    return time.monotonic() if _simulated is None else _simulated.seconds
