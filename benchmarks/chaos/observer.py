"""The benchmark's own node: it feeds, calls and watches the node under test."""

import contextlib
import functools
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from benchmarks.chaos.processes import PATIENCE
from poise.nodes.runtime import EventsExecutor

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_NOT_INPUTS = {"/parameter_events", "/clock", "/rosout"}


class TooLateError(RuntimeError):
    """What was waited for did not come."""


class Observer:
    """A node whose callbacks run inside `until` only.

    Args:
        domain: ROS domain.
        fast: hears several kHz, but its action clients may crash (the events executor of rclpy 7.1).
    """

    def __init__(self, domain: int, fast: bool = False) -> None:
        self.domain = domain
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node("chaos", context=self._context)
        self._executor = (EventsExecutor if fast else SingleThreadedExecutor)(context=self._context)
        self._executor.add_node(self.node)
        self._clients: dict[str, Any] = {}

    def until(self, holds: Callable[[], Any], what: str, timeout: float = PATIENCE) -> float:
        """Run callbacks until a condition holds; returns s waited.

        Raises:
            TooLateError: naming `what`.
        """
        begun = time.monotonic()
        while not holds():
            if time.monotonic() - begun > timeout:
                raise TooLateError(what)
            self._executor.spin_once(timeout_sec=0.01)
        return time.monotonic() - begun

    def rest(self, seconds: float) -> None:
        """Run callbacks for a while."""
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end, "the end of a pause", seconds + 1.0)

    def hear(self, kind: type, topic: str, take: Callable[[Any], None], latched: bool = False) -> None:
        """Subscribe."""
        self.node.create_subscription(kind, topic, take, LATCHED if latched else 1000)

    def call(self, kind: Any, name: str, request: Any, timeout: float = PATIENCE) -> Any:
        """The response of a service.

        Raises:
            TooLateError: when none comes.
        """
        client = self._client(kind, name)
        self.until(client.service_is_ready, f"service {name}", timeout)
        return self._answered(lambda: client.call_async(request), f"an answer of {name}", timeout)

    def _answered(self, send: Callable[[], Any], what: str, timeout: float) -> Any:
        """The result of a future; it is sent again, because a call may be lost while the two find each other."""
        end, futures = time.monotonic() + timeout, list[Any]()
        while not any(future.done() for future in futures):
            left = end - time.monotonic()
            if left <= 0:
                raise TooLateError(what)
            futures.append(send())
            with contextlib.suppress(TooLateError):
                self.until(lambda: any(future.done() for future in futures), what, min(left, max(timeout / 4, 2.0)))
        return next(future.result() for future in futures if future.done())

    def act(self, kind: Any, name: str, goal: Any, timeout: float = PATIENCE) -> Any:
        """The result of a goal; None for one that was refused.

        Raises:
            TooLateError: when none comes.
        """
        client = self.actor(kind, name)
        self.until(client.server_is_ready, f"action {name}", timeout)
        handle = self.begin(client, goal, timeout=timeout)
        if not handle.accepted:
            return None
        future = handle.get_result_async()
        self.until(future.done, f"a result of {name}", timeout)
        return future.result().result

    def actor(self, kind: Any, name: str) -> ActionClient:
        """The client of an action."""
        if name not in self._clients:
            self._clients[name] = ActionClient(self.node, kind, name)
        return self._clients[name]

    def _client(self, kind: Any, name: str) -> Any:
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        return self._clients[name]

    def begin(
        self, client: ActionClient, goal: Any, feedback: Callable[[Any], None] | None = None, timeout: float = PATIENCE
    ) -> Any:
        """Send a goal; returns its handle.

        Raises:
            TooLateError: when there is no answer.
        """
        send = functools.partial(client.send_goal_async, goal, feedback_callback=feedback)
        return self._answered(send, "the acceptance of a goal", timeout)

    def inputs_of(self, name: str) -> dict[str, str]:
        """Topics that a node subscribes to, with their types."""
        there = self._known(self.node.get_subscriber_names_and_types_by_node, name)
        return {topic: kinds[0] for topic, kinds in there if topic not in _NOT_INPUTS and "/_action/" not in topic}

    def outputs_of(self, name: str) -> dict[str, str]:
        """Topics that a node publishes, with their types."""
        there = self._known(self.node.get_publisher_names_and_types_by_node, name)
        return {topic: kinds[0] for topic, kinds in there}

    def _known(self, ask: Callable[[str, str], Any], name: str) -> Any:
        """What the graph says of a node, which may know its topics before it knows its name."""
        self.until(lambda: name in self.node.get_node_names(), f"the name of {name}")
        return ask(name, "/")

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)
