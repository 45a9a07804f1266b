"""Long service calls: processed one at a time in a worker thread, answered when done, or refused."""

import contextlib
import os
import queue
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from dataclasses import dataclass, field
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from poise.errors import ErrorCode, PoiseError
from poise.nodes.answers import Answers
from poise.nodes.runtime import coded, run

_SERVICE_QOS = QoSProfile(depth=1000)
"""Calls that wait in the middleware: the usual 10 would be overwritten by a burst."""
ANSWER_GRACE = 0.25
"""s after its deadline in which a call may still bring what is certified."""
_STEP = 0.05
"""s between looks for answers that are overdue."""
_CROWD = 4
"""Calls in flight beyond which answers are spaced."""
_THREAD = "poise jobs"


@dataclass(frozen=True, eq=False)
class Job:
    """One call that waits or is processed.

    Args:
        work: fills a response; an error it raises becomes the response's code.
        kind: of the service.
        due: when the caller is answered DEADLINE, done or not; on the monotonic clock, s.
        answer: of the caller.
    """

    work: Callable[[Any], None]
    kind: Any
    due: float
    answer: "Future[Any]" = field(default_factory=Future)

    def finish(self, response: Any) -> None:
        """Answer, unless it was answered before."""
        with contextlib.suppress(InvalidStateError):
            self.answer.set_result(response)

    def refuse(self, code: ErrorCode, message: str) -> None:
        """Answer with an error."""
        response = self.kind.Response()
        response.error.code, response.error.message = int(code), message
        self.finish(response)


class Jobs:
    """A worker thread that runs one job at a time, so that shared data needs no locks.

    Every call gets exactly one answer: the work's, BUSY when too many wait, DEADLINE when it is still not done a while
    after that (one long solve cannot be interrupted), CANCELLED when the node goes.

    Args:
        node: whose services these are.
        most: calls that may wait.
    """

    def __init__(self, node: Node, most: int) -> None:
        self._node = node
        self._waiting: queue.Queue[Job | None] = queue.Queue(most)
        self._open: set[Job] = set()
        self._answers = Answers(node, _THREAD)
        node.create_timer(_STEP, self._answer_overdue)
        self._thread = threading.Thread(target=self._run, name=_THREAD, daemon=True)
        self._thread.start()

    def serve(
        self, kind: Any, name: str, work: Callable[[Any, Any, float], None], seconds: Callable[[Any], float]
    ) -> None:
        """Create a service.

        Args:
            kind: its type; responses have a field `error`.
            name: of the service.
            work: `work(request, response, deadline)` fills the response, in the thread, by a moment of the monotonic
                clock; what it raises becomes the response's error.
            seconds: that a request allows for it.
        """

        def receive(request: Any, _: Any) -> "Future[Any]":
            deadline = time.monotonic() + seconds(request)
            job = Job(lambda response: work(request, response, deadline), kind, deadline + ANSWER_GRACE)
            job.answer.add_done_callback(lambda _: self._open.discard(job))
            self._open.add(job)
            self._answers.note_call()
            try:
                self._waiting.put_nowait(job)
            except queue.Full:
                job.refuse(ErrorCode.BUSY, f"{self._waiting.maxsize} calls wait already; call again later")
            return job.answer

        service = self._node.create_service(kind, name, receive, qos_profile=_SERVICE_QOS)
        send = service.send_response

        def send_when_done(answer: "Future[Any]", header: Any) -> None:
            answer.add_done_callback(lambda done: self._answers.put(send, done.result(), header, self._crowded))

        # The executors hand what `receive` returned to this; rclpy has no other way to answer later.
        service.send_response = send_when_done

    @property
    def _crowded(self) -> bool:
        return len(self._open) >= _CROWD

    def do(self, work: Callable[[], None]) -> bool:
        """Run `work` between the calls; False when too many calls wait."""
        try:
            self._waiting.put_nowait(Job(lambda _: work(), None, float("inf")))
        except queue.Full:
            return False
        return True

    def close(self) -> None:
        """Answer CANCELLED to waiting calls and end the thread; a running job ends by itself or with the process."""
        for job in list(self._open):
            job.refuse(ErrorCode.CANCELLED, "the node shuts down; call again when it is back")
        with contextlib.suppress(queue.Empty):
            while True:
                self._waiting.get_nowait()
        self._waiting.put(None)
        self._answers.close()
        self._thread.join(1.0)

    def _run(self) -> None:
        while (job := self._waiting.get()) is not None:
            if job.answer.done():
                continue
            response = None if job.kind is None else job.kind.Response()
            error = self._done(job, response)
            if response is not None:
                if error is not None:
                    response.error.code, response.error.message = int(error.code), error.message
                job.finish(response)

    def _done(self, job: Job, response: Any) -> PoiseError | None:
        """Run the work; return its error, None for success."""
        try:
            job.work(response)
        except PoiseError as error:
            return error
        except Exception as error:
            if rclpy.ok():
                self._node.get_logger().error(f"internal error: {error!r}", throttle_duration_sec=1.0)
            return coded(error)
        return None

    def _answer_overdue(self) -> None:
        now = time.monotonic()
        for job in list(self._open):
            if now > job.due:
                job.refuse(ErrorCode.DEADLINE, "the deadline passed before anything was certified; allow more time")


def run_with_jobs(make_node: Callable[[], Node], args: list[str] | None = None) -> None:
    """Run a node that has jobs; the process ends also while their thread is inside a solver."""
    try:
        run(make_node, args)
    except SystemExit as end:
        _leave(end.code)


def _leave(status: Any) -> None:
    """End the process: with a thread inside a solver, Python's own way out would abort in it."""
    if any(thread.name == _THREAD for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status if isinstance(status, int) else 1)
    sys.exit(status)
