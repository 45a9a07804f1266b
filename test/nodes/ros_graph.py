"""One running node of the package, and a node of the test that watches it; the fixtures are in conftest.py."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.client import Client
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from poise.nodes.runtime import EventsExecutor

TIMEOUT = 120.0
"""How long a wait may last, s: far above what is expected, so that only what never comes fails."""
RETRY = 0.3
"""s after which a request that met a node too early is sent again."""


class NodeProcess:
    """One running executable of the package.

    Args:
        command: executable and arguments.
        environment: of the child.
        log: file for what it prints.
    """

    def __init__(self, command: list[str], environment: Mapping[str, str], log: Path) -> None:
        # However the test run ends, the node ends with it.
        leash = ["setpriv", "--pdeathsig", "KILL"] if shutil.which("setpriv") else []
        self._log = log
        with log.open("w") as sink:
            self.process = subprocess.Popen(
                [*leash, *command],
                env=dict(environment),
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def output(self) -> str:
        """Everything printed so far, both streams."""
        return self._log.read_text(errors="replace")

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the node (and the processes it has started)."""
        os.killpg(self.process.pid, number)

    def wait(self, timeout: float = TIMEOUT) -> int:
        """Wait for its end; return the exit status (negative: the signal that ended it)."""
        return self.process.wait(timeout)

    def stop(self, number: signal.Signals = signal.SIGINT, timeout: float = TIMEOUT) -> int:
        """Signal it and wait for its end; one that does not end is killed, and the test fails."""
        if self.process.poll() is None:
            self.send(number)
        try:
            return self.wait(timeout)
        except subprocess.TimeoutExpired:
            self.send(signal.SIGKILL)
            self.process.wait()
            pytest.fail(f"did not stop within {timeout} s of {number.name}:\n{self.output}")


class Graph:
    """The test's own node; its callbacks run only inside the waits, so tests need no locks."""

    def __init__(self, domain: int) -> None:
        self.domain = domain
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node("test", context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)

    def add(self, node: Node) -> None:
        """Run the callbacks of another node in the waits too; its context is that of `self.node`."""
        self._executor.add_node(node)

    def wait_for(self, condition: Callable[[], Any], timeout: float = TIMEOUT, what: str = "") -> Any:
        """Spin until the condition holds and return its value; fail, naming `what`, at the deadline."""
        deadline = time.monotonic() + timeout
        while not (value := condition()):
            if time.monotonic() > deadline:
                pytest.fail(f"not within {timeout} s: {what or condition}")
            self._executor.spin_once(timeout_sec=0.02)
        return value

    def collect(self, topic: str, message_type: type, qos: QoSProfile | int = 1000) -> list[Any]:
        """Subscribe; return the list that grows with every message."""
        messages: list[Any] = []
        self.node.create_subscription(message_type, topic, messages.append, qos)
        return messages

    def meet(self) -> None:
        """Wait until every other node knows all endpoints that this one has made so far.

        A publisher that has matched a reader may still be unknown to that reader, which then misses what is published.
        Endpoints are announced in the order of their making, so a node that answers a client made now knows the
        earlier ones. The request itself may come too early, and is sent again.
        """
        own = self.node.get_name(), self.node.get_namespace()
        for name, namespace in self.node.get_node_names_and_namespaces():
            if (name, namespace) == own:
                continue
            client = self.node.create_client(GetParameters, f"{namespace.rstrip('/')}/{name}/get_parameters")
            try:
                self.wait_for(client.service_is_ready, what=f"the parameters of {name}")
                self.answer(client, GetParameters.Request())
            finally:
                self.node.destroy_client(client)

    def answer(self, client: Client, request: Any) -> Any:
        """The first response to a request that does no harm when it is sent again, because it may come too early."""
        answers: list[Any] = []
        sent = -RETRY

        def answered() -> Any:
            nonlocal sent
            if time.monotonic() - sent > RETRY:
                sent = time.monotonic()
                answers.append(client.call_async(request))
            return next((answer for answer in answers if answer.done()), None)

        return self.wait_for(answered, what=f"an answer of {client.srv_name}").result()

    def call(self, service_type: type, name: str, request: Any, timeout: float = TIMEOUT) -> Any:
        """Call a service, waiting for it to appear; return the response."""
        client = self.node.create_client(service_type, name)
        try:
            self.wait_for(client.service_is_ready, timeout, f"service {name}")
            self.meet()
            future = client.call_async(request)
            self.wait_for(future.done, timeout, f"response of {name}")
            return future.result()
        finally:
            self.node.destroy_client(client)

    def set_parameters(self, node: str, **values: float) -> list[bool]:
        """Set numbers of a node, one after the other; whether each was taken."""
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        )
        return [result.successful for result in self.call(SetParameters, f"{node}/set_parameters", request).results]

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)
