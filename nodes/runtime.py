"""Shared by all nodes: clean start and stop, guarded callbacks, errors as numbered codes."""

import ctypes
import functools
import signal
import sys
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy

from poise.errors import ErrorCode, PoiseError
from poise.nodes.clock import follow_clock
from poise.nodes.responses import send_responses_again
from poise_msgs.msg import ErrorCode as ErrorCodeMessage

try:  # at 1 kHz the events executor takes a fifth off the latency
    from rclpy.experimental import EventsExecutor
except ImportError:  # an rclpy without it
    EventsExecutor = SingleThreadedExecutor

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SCANS = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of segmented_object: one scan may give several objects at once."""
TF_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For subscribers: every broadcaster has one latched message."""

# EventsExecutor.spin() holds a core and ignores signals (rclpy 7.1.6): step it instead.
_SPIN_STEP = 0.5


def run(make_node: Callable[[], Node], args: list[str] | None = None) -> None:
    """Start a node, spin it until Ctrl-C, SIGTERM or its own shutdown, and leave nothing behind.

    Exits with the error's status and one line when the node cannot start (a bad parameter, for one).
    """
    # Before init: rclpy's own handler, in C, does the shutdown; Python's handler would raise during that shutdown.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    rclpy.init(args=args)
    send_responses_again()
    executor = EventsExecutor()
    # It is never destroyed: a signal while it takes in entities makes it forget some, and its destructor would abort
    # (rclpy 7.1.6).
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(executor))
    node = None
    status = 0
    try:
        node = make_node()
        follow_clock(node)
        executor.add_node(node)
        node.get_logger().info("ready")
        while rclpy.ok():
            executor.spin_once(timeout_sec=_SPIN_STEP)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except PoiseError as error:
        print(f"{error.code.name}: {error.message}", file=sys.stderr)
        status = error.exit_status
    except (RCLError, ValueError):  # an action server that is made during the shutdown raises a ValueError
        if rclpy.ok():
            raise
    finally:
        executor.shutdown()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    sys.exit(status)


def guarded(node: Node, callback: Callable[..., Any]) -> Callable[..., Any]:
    """Log an exception of a callback, at most once a second, so that it does not end the node."""

    @functools.wraps(callback)
    def call(*arguments: Any) -> Any:
        try:
            return callback(*arguments)
        except PoiseError as error:
            node.get_logger().error(f"{error.code.name}: {error.message}", throttle_duration_sec=1.0)
        except Exception as error:
            if rclpy.ok():
                name = getattr(callback, "__name__", repr(callback))
                node.get_logger().error(f"{name}: {error!r}", throttle_duration_sec=1.0)
        return None

    return call


def publish(publisher: Publisher, message: Any) -> None:
    """Publish from any thread; what comes while the process shuts down is dropped."""
    try:
        publisher.publish(message)
    except RCLError:
        if rclpy.ok():
            raise


def subscribe(
    node: Node, kind: type, topic: str, callback: Callable[..., Any], depth: int, *, raw: bool = False
) -> None:
    """Subscribe reliably; from a publisher that offers only best effort, by best effort, and report that once.

    Sensor drivers often publish by best effort, and DDS gives none of these messages to a reliable subscription.
    """
    relaxed: list[Any] = []
    take = guarded(node, callback)

    def take_reliable(message: Any) -> None:
        if not relaxed:  # else a reliable publisher is heard by the other subscription too
            take(message)

    def relax(event: Any) -> None:
        if relaxed or event.last_policy_kind != QoSPolicyKind.RELIABILITY:
            return
        qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        relaxed.append(node.create_subscription(kind, topic, take, qos, raw=raw))
        node.get_logger().warning(
            f"{topic} is published by best effort: messages may be lost; publish it reliably to avoid that"
        )

    events = SubscriptionEventCallbacks(incompatible_qos=relax)
    node.create_subscription(kind, topic, take_reliable, QoSProfile(depth=depth), raw=raw, event_callbacks=events)


def topic_hint(node: Node, topic: str, kind: str) -> str:
    """Why nothing comes on a topic: it carries another type; or which other topics carry this one. Empty: unknown.

    Args:
        node: that subscribes.
        topic: relative name.
        kind: type, such as `geometry_msgs/msg/WrenchStamped`.
    """
    name, there = node.resolve_topic_name(topic), dict(node.get_topic_names_and_types())
    if others := [other for other in there.get(name, ()) if other != kind]:
        return f"; {name} carries {', '.join(others)}, not {kind}"
    if node.count_publishers(topic):
        return (
            f"; {name} has a publisher, of which nothing arrives: it is silent, or Fast DDS holds shared memory of a "
            "process that was killed: start this node again"
        )
    if elsewhere := sorted(other for other, kinds in there.items() if kind in kinds and other != name):
        return f"; {kind} is on {', '.join(elsewhere)}: remap {topic} to it"
    return ""


def coded(failure: Exception) -> PoiseError:
    """The error that a caller gets for a failure: a PoiseError as it is, INTERNAL for any other exception."""
    if isinstance(failure, PoiseError):
        return failure
    return PoiseError(ErrorCode.INTERNAL, f"internal error: {failure!r}; please report it")


def end_goal(goal: Any, succeeded: bool) -> None:
    """Set the status a goal ends in: succeeded, else canceled if that was asked for, else aborted."""
    if succeeded:
        goal.succeed()
    elif goal.is_cancel_requested:
        goal.canceled()
    else:
        goal.abort()


def to_message(error: PoiseError | None) -> ErrorCodeMessage:
    """Turn an error (None: success) into the numbered code of a response."""
    if error is None:
        return ErrorCodeMessage(code=ErrorCode.OK)
    return ErrorCodeMessage(code=error.code, message=error.message)
