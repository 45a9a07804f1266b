"""Long service calls: taken in by the executor, processed by threads in the order of their deadlines, or refused."""

import contextlib
import heapq
import itertools
import os
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
from poise.nodes.clock import STEADY
from poise.nodes.runtime import coded, run
from poise.nodes.workers import NOTHING_IN_TIME

_SERVICE_QOS = QoSProfile(depth=1000)
"""Calls that wait in the middleware: the usual 10 would be overwritten by a burst."""
ANSWER_GRACE = 0.25
"""s after its deadline in which a call may still bring what is certified."""
_STEP = 0.05
"""s between looks for answers that are overdue."""
_CROWD = 4
"""Calls in flight, besides heavy ones, from which on answers are spaced."""
_THREAD = "poise jobs"


@dataclass(frozen=True)
class Task:
    """What a call asks for.

    Args:
        work: `work(job, thread)` returns the response; what it raises becomes the response's error.
        heavy: it may take long: one thread is kept free of such tasks when there are several threads.
        alone: no other task with this mark runs at the same time.
        size: bytes that it keeps while it waits.
    """

    work: Callable[["Job", int], Any]
    heavy: bool = False
    alone: bool = False
    size: int = 0


@dataclass(eq=False)
class Job:
    """One call that waits or is processed.

    Args:
        kind: of the service; None: nothing waits for an answer.
        deadline: of the computation; on the monotonic clock, s.
        task: what it asks for.
        complete: called with each response that refuses it.
        answer: of the caller.
    """

    kind: Any
    deadline: float
    task: Task | None = None
    complete: Callable[[Any], None] | None = None
    answer: "Future[Any]" = field(default_factory=Future)
    _claimed: bool = False
    _lock: Any = field(default_factory=threading.Lock)

    @property
    def due(self) -> float:
        """When the caller is answered DEADLINE, done or not."""
        return self.deadline + ANSWER_GRACE

    def claim(self) -> bool:
        """Whether the caller still waits; if so, only `finish` answers from now on, so that a change can be made."""
        with self._lock:
            if self.answer.done():
                return False
            self._claimed = True
            return True

    def finish(self, response: Any) -> None:
        """Answer, unless it was answered before."""
        with contextlib.suppress(InvalidStateError):
            self.answer.set_result(response)

    def refuse(self, code: ErrorCode, message: str, by_clock: bool = False) -> None:
        """Answer with an error; by the clock only what has not been claimed."""
        if self.kind is None:
            return
        response = self.kind.Response()
        response.error.code, response.error.message = int(code), message
        if self.complete is not None:
            self.complete(response)
        with self._lock:
            if not (by_clock and self._claimed):
                self.finish(response)


class Jobs:
    """Threads that process calls, the one with the earliest deadline first.

    Every call gets exactly one answer: the work's, BUSY when too many wait, DEADLINE when it is still not done a while
    after that, CANCELLED when the node goes. rclpy does not say who calls. Therefore heavy and other calls are kept
    apart: each kind has its own queue, and the first thread takes no heavy ones unless it is the only one.

    Args:
        node: whose services these are.
        most: calls that may wait.
        most_heavy: heavy calls that may wait; None: as many as `most`.
        threads: that process calls; with one, shared data needs no locks.
        most_bytes: of the calls that wait.
    """

    def __init__(
        self, node: Node, most: int, most_heavy: int | None = None, threads: int = 1, most_bytes: float = float("inf")
    ) -> None:
        self._node, self.most = node, most
        self._most = {False: most, True: most if most_heavy is None else most_heavy}
        self._most_bytes = most_bytes
        self._waiting: dict[bool, list[tuple[float, int, Job]]] = {False: [], True: []}
        self._bytes = 0
        self._counter = itertools.count()
        self._lock = threading.Lock()
        self._awake = [threading.Condition(self._lock) for _ in range(threads)]
        self._idle = [True] * threads
        self._alone = self._closed = False
        self._open: set[Job] = set()
        self._answers = Answers(node, _THREAD)
        node.create_timer(_STEP, self._answer_overdue, clock=STEADY)
        self._threads = [
            threading.Thread(target=self._run, args=(number,), name=_THREAD, daemon=True) for number in range(threads)
        ]
        for thread in self._threads:
            thread.start()

    def serve(
        self,
        kind: Any,
        name: str,
        task: Callable[[Any], Task],
        seconds: Callable[[Any], float],
        complete: Callable[[Any], None] | None = None,
    ) -> None:
        """Create a service.

        Args:
            kind: its type; responses have a field `error`.
            name: of the service.
            task: called in the executor with a request; an error that it raises is answered at once.
            seconds: that a request allows for it.
            complete: called with each response that refuses a call.
        """

        def receive(request: Any, _: Any) -> "Future[Any]":
            arrived = time.monotonic()
            self._answers.note_call()
            job = Job(kind, arrived, complete=complete)
            self._open.add(job)
            job.answer.add_done_callback(lambda _: self._open.discard(job))
            try:
                job.deadline = arrived + seconds(request)
                job.task = task(request)
            except Exception as error:
                known = self._reported(error)
                job.refuse(known.code, known.message)
                return job.answer
            if reason := self._refusal(job):
                job.refuse(ErrorCode.BUSY, f"{reason}; call again later")
            return job.answer

        service = self._node.create_service(kind, name, receive, qos_profile=_SERVICE_QOS)
        send = service.send_response

        def send_when_done(answer: "Future[Any]", header: Any) -> None:
            answer.add_done_callback(lambda done: self._answers.put(send, done.result(), header, self._crowded))

        # The executors hand what `receive` returned to this; rclpy has no other way to answer later.
        service.send_response = send_when_done

    @property
    def _crowded(self) -> bool:
        return sum(job.task is not None and not job.task.heavy for job in list(self._open)) >= _CROWD

    @property
    def state(self) -> dict[str, int]:
        """How many calls wait and run, by name."""
        with self._lock:
            waiting, heavy = len(self._waiting[False]), len(self._waiting[True])
            return {"waiting": waiting, "waiting_heavy": heavy, "running": self._idle.count(False)}

    def do(self, work: Callable[[], None]) -> bool:
        """Run `work` between the calls; False when too many calls wait."""
        return self.add(Task(lambda *_: work()), float("inf"))

    def add(self, task: Task, seconds: float) -> bool:
        """Run a task for which nothing waits, within a time, s; False when too many calls wait."""
        return not self._refusal(Job(None, time.monotonic() + seconds, task))

    def close(self) -> None:
        """Answer CANCELLED to waiting calls and end the threads; running jobs end by themselves or with the process."""
        for job in list(self._open):
            job.refuse(ErrorCode.CANCELLED, "the node shuts down; call again when it is back")
        with self._lock:
            self._closed = True
            for awake in self._awake:
                awake.notify()
        self._answers.close()
        for thread in self._threads:
            thread.join(1.0)

    def _refusal(self, job: Job) -> str:
        """Let a job wait; if it cannot, why."""
        task = job.task
        if task is None:
            return "there is nothing to do"
        with self._lock:
            waiting = self._waiting[task.heavy]
            if len(waiting) >= self._most[task.heavy]:
                return f"{len(waiting)} calls wait already"
            if self._bytes + task.size > self._most_bytes:
                return f"calls of {self._bytes / 1e6:.0f} MB wait already"
            self._bytes += task.size
            heapq.heappush(waiting, (job.deadline, next(self._counter), job))
            self._wake()
        return ""

    def _wake(self) -> None:
        """Wake the first idle thread for which there is a job; it wakes the next when it has taken one.

        No other is woken: each switch of threads delays the answers.
        """
        for number, idle in enumerate(self._idle):
            if idle and self._next(number) is not None:
                self._awake[number].notify()
                return

    def _next(self, number: int) -> tuple[float, int, Job] | None:
        """The entry of the next job for a thread; None to wait."""
        if len(self._idle) == 1:
            order = [False, True]
        elif number == 0:
            order = [False]
        else:  # while a thread before this one is idle, that one takes what is not heavy: its caches are warm
            order = [True] if any(self._idle[:number]) else [True, False]
        for heavy in order:
            waiting = self._waiting[heavy]
            for entry in sorted(waiting) if self._alone else waiting[:1]:
                task = entry[2].task
                if task is not None and not (task.alone and self._alone):
                    return entry
        return None

    def _run(self, number: int) -> None:
        while True:
            with self._lock:
                while not self._closed and (entry := self._next(number)) is None:
                    self._awake[number].wait()
                if self._closed:
                    return
                job, task = entry[2], entry[2].task
                self._waiting[task.heavy].remove(entry)
                heapq.heapify(self._waiting[task.heavy])
                self._bytes -= task.size
                self._idle[number] = False
                self._alone |= task.alone
                self._wake()
            try:
                if not job.answer.done():
                    self._answer(job, task, number)
            finally:
                with self._lock:
                    self._idle[number] = True
                    self._alone &= not task.alone
                    self._wake()

    def _answer(self, job: Job, task: Task, number: int) -> None:
        try:
            response = task.work(job, number)
        except Exception as error:
            known = self._reported(error)
            job.refuse(known.code, known.message)
        else:
            if job.kind is not None:
                job.finish(response)

    def _reported(self, error: Exception) -> PoiseError:
        """The error that the caller gets; an unexpected one is logged, too."""
        if (not isinstance(error, PoiseError) or error.code == ErrorCode.INTERNAL) and rclpy.ok():
            self._node.get_logger().error(f"internal error: {error!r}", throttle_duration_sec=1.0)
        return coded(error)

    def _answer_overdue(self) -> None:
        """Answer what is overdue; those of it that still wait give up their places and bytes."""
        now = time.monotonic()
        for job in list(self._open):
            if now > job.due:
                job.refuse(ErrorCode.DEADLINE, NOTHING_IN_TIME, by_clock=True)
        with self._lock:
            for waiting in self._waiting.values():
                gone = [entry for entry in waiting if entry[2].answer.done()]
                for entry in gone:
                    waiting.remove(entry)
                    self._bytes -= entry[2].task.size if entry[2].task is not None else 0
                heapq.heapify(waiting)
            self._wake()  # the thread that was woken for one of them finds nothing, and wakes no other


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
