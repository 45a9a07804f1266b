"""Sends answers of services from a separate thread, slowly enough for clients that are still sending calls."""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import rclpy
from rclpy.node import Node

_KEPT = 8
"""Answers sent at once: a client of rclpy keeps ten, and loses older ones while it does not spin."""
_SPACING = 0.002
"""s between further ones, when many calls are in flight."""
QUIET, LONGEST = 0.02, 0.25
"""s without a new call after which clients are taken to listen again; s for which answers wait for that."""


class Answer(NamedTuple):
    """One answer, and whether many others are in flight."""

    send: Callable[[Any, Any], None]
    response: Any
    header: Any
    crowded: bool
    ready: float


class Answers:
    """Sends answers in the order in which they become ready: at once while few calls are in flight.

    Args:
        node: whose services are answered; an answer that cannot be sent is logged there.
        name: of the thread.
    """

    def __init__(self, node: Node, name: str) -> None:
        self._node = node
        self._ready: queue.SimpleQueue[Answer | None] = queue.SimpleQueue()
        self._called = 0.0
        self._sent: deque[float] = deque(maxlen=_KEPT)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def note_call(self) -> None:
        """A call has arrived."""
        self._called = time.monotonic()

    def put(self, send: Callable[[Any, Any], None], response: Any, header: Any, crowded: bool) -> None:
        """Send an answer when its client can be expected to receive it.

        A thread of jobs sends it itself, which saves a switch of threads; an executor must not wait for DDS.
        """
        answer = Answer(send, response, header, crowded, time.monotonic())
        if crowded or threading.current_thread() is threading.main_thread() or not self._ready.empty():
            self._ready.put(answer)
        else:
            self._send(answer)

    def close(self) -> None:
        """Send the answers that are ready, and end the thread."""
        self._ready.put(None)
        self._thread.join(1.0)

    def _run(self) -> None:
        while (answer := self._ready.get()) is not None:
            sent = self._sent
            if answer.crowded and len(sent) == _KEPT:
                time.sleep(max(0.0, sent[0] + _KEPT * _SPACING - time.monotonic()))
                while time.monotonic() < min(self._called + QUIET, answer.ready + LONGEST):
                    time.sleep(_SPACING)
            self._send(answer)

    def _send(self, answer: Answer) -> None:
        try:
            answer.send(answer.response, answer.header)
        except Exception as error:  # one answer that cannot be sent must not keep back the others
            if rclpy.ok():  # otherwise the node is shutting down
                self._node.get_logger().error(f"an answer was not sent: {error!r}", throttle_duration_sec=1.0)
        self._sent.append(time.monotonic())
