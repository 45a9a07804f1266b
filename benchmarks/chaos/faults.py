"""What is done to a node, one function each; each returns when the fault is over."""

import math
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterDescriptor, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage

from benchmarks.chaos.hostile import hostile, message_type
from benchmarks.chaos.observer import Observer, TooLateError
from benchmarks.chaos.processes import NO_SPACE, NodeProgram, environment
from benchmarks.chaos.subjects import Subject

_SLOW_READER = """
import rclpy, sys
from importlib import import_module
from rclpy.qos import QoSProfile, HistoryPolicy
rclpy.init()
node = rclpy.create_node("slow_reader")
for pair in sys.argv[1:]:
    topic, kind = pair.split("=")
    package, _, name = kind.split("/")
    qos = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=0)
    node.create_subscription(getattr(import_module(package + ".msg"), name), topic, lambda message: None, qos)
print("ready", flush=True)
rclpy.spin(node)
"""
_HOUR = 3600.0


@dataclass
class Bench:
    """One node under test, its companions, and the observer."""

    subject: Subject
    program: NodeProgram
    companions: list[NodeProgram]
    observer: Observer
    rng: random.Random = field(default_factory=lambda: random.Random(0))
    notes: list[str] = field(default_factory=list)

    def everything(self) -> list[NodeProgram]:
        """The node and its companions."""
        return [*self.companions, self.program]


def kill(bench: Bench) -> None:
    """SIGKILL in the middle of a goal; the arm comes to rest; the node is started again."""
    bench.subject.begin(bench.observer)
    bench.program.kill()
    bench.observer.rest(0.2)  # what was sent before is heard now
    if bench.subject.arm and bench.companions:
        bench.subject.hear_arm()
        bench.notes.append(f"arm at rest after {bench.observer.until(_rest(bench), 'the arm to rest'):.1f} s")
    bench.program.start()


def freeze(bench: Bench) -> None:
    """SIGSTOP for 2 s in the middle of a goal."""
    bench.subject.begin(bench.observer)
    bench.program.send(signal.SIGSTOP)
    if bench.subject.arm and bench.companions:
        bench.subject.hear_arm()
    bench.observer.rest(2.0)
    bench.program.send(signal.SIGCONT)
    if bench.subject.arm and bench.companions:
        bench.observer.until(_rest(bench), "the arm to rest")


def _rest(bench: Bench) -> Callable[[], bool]:
    return lambda: bench.subject.arm_is_at_rest


def clock_jump(bench: Bench) -> None:
    """The companions' stamps jump an hour ahead and back; so does the ROS time of the node."""
    publisher = bench.observer.node.create_publisher(Clock, "/clock", 10)
    _set(bench, [Parameter("use_sim_time", value=True).to_parameter_msg()])
    for seconds in (1000, 1001, 4600, 10, 11):
        clock = Clock()
        clock.clock.sec = seconds
        publisher.publish(clock)
        bench.observer.rest(0.2)
    _set(bench, [Parameter("use_sim_time", value=False).to_parameter_msg()])
    bench.observer.node.destroy_publisher(publisher)
    for robot in bench.companions:
        before = dict(robot.parameters)
        for start in (time.time() + _HOUR, None):
            robot.kill()
            robot.parameters = before | ({} if start is None else {"start_time": start})
            robot.start()
            bench.observer.rest(2.0)


def bad_messages(bench: Bench) -> None:
    """NaN, infinite, huge, empty and short messages on every topic that the node reads."""
    node = bench.observer.node
    bench.subject.spoil()
    for topic, kind in bench.observer.inputs_of(bench.program.name).items():
        publisher = node.create_publisher(message_type(kind), topic, _qos(topic))
        bench.observer.until(publisher.get_subscription_count, f"{topic} to match")
        for _ in range(100):
            try:
                publisher.publish(hostile(message_type(kind), bench.rng))
            except (UnicodeError, TypeError):  # a text with a null
                continue
            bench.observer.rest(0.002)
        for size in (0, 1, 4, 5, 13):  # not a whole message
            publisher.publish(b"\x00\x01\x00\x00" + b"\xff" * size)
        bench.observer.rest(0.1)
        node.destroy_publisher(publisher)
    bench.subject.heal(bench.observer)


def flood(bench: Bench) -> None:
    """3,000 messages on every topic that the node reads, as fast as they can be sent."""
    node = bench.observer.node
    for topic, kind in bench.observer.inputs_of(bench.program.name).items():
        message_class = message_type(kind)
        publisher = node.create_publisher(message_class, topic, _qos(topic))
        bench.observer.until(publisher.get_subscription_count, f"{topic} to match")
        content = serialize_message(message_class())
        for _ in range(3000):
            publisher.publish(content)
        node.destroy_publisher(publisher)


def slow_subscriber(bench: Bench) -> None:
    """A reliable reader of every topic of the node, which keeps all and is stopped for 3 s."""
    there = bench.observer.outputs_of(bench.program.name)
    pairs = [f"{topic}={kind}" for topic, kind in there.items() if "_action" not in topic and "rosout" not in topic]
    folder = bench.program.folder
    with subprocess.Popen(
        [sys.executable, "-c", _SLOW_READER, *pairs],
        env=environment(bench.observer.domain, folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as reader:
        if reader.stdout is not None:
            reader.stdout.readline()
        bench.observer.rest(0.5)
        reader.send_signal(signal.SIGSTOP)
        bench.observer.rest(3.0)
        reader.kill()


def lost_inputs(bench: Bench) -> None:
    """The companions are killed for 3 s; tf falls apart into two trees."""
    for robot in bench.companions:
        robot.kill()
    publisher = bench.observer.node.create_publisher(TFMessage, "tf", 100)
    for number in range(100):
        loose = TransformStamped()
        loose.header.frame_id, loose.child_frame_id = f"lost_{number % 2}", f"loose_{number % 3}"
        loose.header.stamp.sec = number
        loose.transform.rotation.w = 1.0
        publisher.publish(TFMessage(transforms=[loose]))
        bench.observer.rest(0.03)
    bench.observer.node.destroy_publisher(publisher)
    for robot in bench.companions:
        robot.start()


def full_disk(bench: Bench) -> None:
    """The node is started where every write to a file fails."""
    bench.program.kill()
    bench.observer.rest(0.2)
    bench.program.start(full_disk=True)


def disk_fills(bench: Bench) -> None:
    """From the middle of a goal on, every write to a file fails, in all processes of the node."""
    bench.subject.begin(bench.observer)
    for process in bench.program.processes():
        _, most = resource.prlimit(process, resource.RLIMIT_FSIZE)
        resource.prlimit(process, resource.RLIMIT_FSIZE, (NO_SPACE, most))
    bench.observer.rest(0.5)


def wrong_parameters(bench: Bench) -> None:
    """Every parameter is set to values outside of its range, to NaN and to other types; none may be taken."""
    observer, name = bench.observer, bench.program.name
    names = observer.call(ListParameters, f"{name}/list_parameters", ListParameters.Request()).result.names
    names = [one for one in names if not one.startswith(("qos_overrides", "use_sim_time", "start_type"))]
    ask = DescribeParameters.Request(names=names)
    before = observer.call(GetParameters, f"{name}/get_parameters", GetParameters.Request(names=names)).values
    for descriptor in observer.call(DescribeParameters, f"{name}/describe_parameters", ask).descriptors:
        wrong = _outside(descriptor)
        results = _set(bench, [ParameterMessage(name=descriptor.name, value=value) for value in wrong])
        for value, result in zip(wrong, results, strict=True):
            if result.successful:
                bench.subject.false.append(f"parameter {descriptor.name} took {_content(value)}")
    after = observer.call(GetParameters, f"{name}/get_parameters", GetParameters.Request(names=names)).values
    if str(before) != str(after):  # NaN is a default
        bench.subject.false.append("parameters changed")


def _outside(descriptor: ParameterDescriptor) -> list[ParameterValue]:
    """Values that a parameter must refuse: of another type, not finite, beyond its range."""
    kinds = ParameterType
    other = kinds.PARAMETER_BYTE_ARRAY
    wrong = [ParameterValue(type=other, byte_array_value=[b"x"])]
    for limits in descriptor.floating_point_range:
        span = limits.to_value - limits.from_value
        for value in (math.nan, math.inf, -math.inf, limits.from_value - span - 1, limits.to_value + span + 1):
            wrong.append(ParameterValue(type=kinds.PARAMETER_DOUBLE, double_value=value))
    for whole in descriptor.integer_range:
        for number in (whole.from_value - 1, whole.to_value + 1):
            wrong.append(ParameterValue(type=kinds.PARAMETER_INTEGER, integer_value=number))
    return wrong


def _content(value: ParameterValue) -> str:
    if value.type == ParameterType.PARAMETER_DOUBLE:
        return f"{value.double_value:g}"
    return str(value.integer_value) if value.type == ParameterType.PARAMETER_INTEGER else "bytes"


def _set(bench: Bench, values: list[ParameterMessage]) -> list[Any]:
    name = bench.program.name
    request = SetParameters.Request(parameters=values)
    return list(bench.observer.call(SetParameters, f"{name}/set_parameters", request).results)


def _qos(topic: str) -> QoSProfile:
    latched = topic.endswith(("_static", "description", "assembly", "estimate", "object", "events", "world", "limits"))
    durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=100, durability=durability)


FAULTS: dict[str, Callable[[Bench], None]] = {
    "kill -9, restart": kill,
    "stopped 2 s": freeze,
    "clock jump": clock_jump,
    "bad messages": bad_messages,
    "flood": flood,
    "slow reader": slow_subscriber,
    "inputs lost": lost_inputs,
    "full disk": full_disk,
    "disk fills": disk_fills,
    "wrong parameters": wrong_parameters,
}

__all__ = ["FAULTS", "Bench", "TooLateError"]
