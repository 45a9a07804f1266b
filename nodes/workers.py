"""Processes that do the work of a node: they are stopped at the deadline, also inside a native solver."""

import gc
import json
import os
import resource
import select
import signal
import socket
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from poise.errors import ErrorCode, NoAnswerError, PoiseError

_START_SECONDS = 60.0
"""s that a worker may need to start, on a loaded machine."""
_END_SECONDS = 1.0
"""s for which the end of a killed process is awaited."""

Exchange = tuple[dict[str, Any], list[bytes]]
"""A header of plain values, and serialized messages."""
Answering = Callable[[dict[str, Any], list[bytes]], Exchange]


class WorkerTemplate:
    """A process that forks workers: with all modules and without threads, so that a new worker is there at once.

    It is a copy of the process that makes it, which therefore must not have threads yet: make it before `rclpy.init`.

    Args:
        make: called in each worker with plain settings; returns what answers an exchange.
    """

    def __init__(self, make: Callable[..., Answering]) -> None:
        self._lock = threading.Lock()
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        gc.freeze()  # so that the collector does not copy pages of modules
        if os.fork() == 0:
            self._socket.close()
            _fork_on_request(theirs, make)
        theirs.close()

    def fork(self, settings: Any, pipe: Connection, life: Connection) -> int:
        """Start a worker with its ends of two pipes; its process id.

        Raises:
            PoiseError: INTERNAL when the template has ended.
        """
        with self._lock:
            try:
                socket.send_fds(self._socket, [json.dumps(settings).encode()], [pipe.fileno(), life.fileno()])
                answer = self._socket.recv(100)
            except OSError:
                answer = b""
        if not answer:
            raise PoiseError(ErrorCode.INTERNAL, "the process that starts the workers has ended: restart the node")
        return int(answer)


@dataclass
class Worker:
    """One process that answers one exchange at a time; started when first needed, and again after it was stopped.

    Args:
        template: that forks it.
        settings: of the worker; plain values.
        memory: bytes of address space that it may take, besides what its modules take.
    """

    template: WorkerTemplate
    settings: Sequence[Any]
    memory: int
    starts: int = 0
    state: dict[str, Any] = field(default_factory=dict)
    """What its owner knows about the process of the moment; empty after a start."""
    _process: int | None = None
    _pipe: Any = None
    _life: Any = None

    def start(self) -> None:
        """Start the process, unless it runs.

        Raises:
            PoiseError: INTERNAL when that fails.
        """
        if self._process is not None and not self._ended:
            return
        self.stop()
        (self._pipe, theirs), (self._life, watched) = _pipe(), _pipe()
        process = self.template.fork([list(self.settings), self.memory], theirs, watched)
        self._process = os.pidfd_open(process)
        self.starts += 1
        theirs.close()
        watched.close()
        if not self._pipe.poll(_START_SECONDS):
            self.stop()
            raise PoiseError(ErrorCode.INTERNAL, f"a worker did not start within {_START_SECONDS:g} s")
        self._pipe.recv_bytes()

    def ask(self, header: dict[str, Any], messages: Sequence[bytes], due: float) -> Exchange:
        """Exchange with the process; it is stopped when it has not answered by `due` on the monotonic clock.

        Raises:
            NoAnswerError: DEADLINE when it was stopped.
            PoiseError: INTERNAL when it ended by itself.
        """
        try:
            self.start()
            _send(self._pipe, header, messages)
            if self._pipe.poll(max(due - time.monotonic(), 0.0)):
                return _received(self._pipe)
        except (EOFError, OSError) as error:
            self.stop()
            raise PoiseError(
                ErrorCode.INTERNAL, "the worker ended during this call: it may need more memory than worker_memory"
            ) from error
        self.stop()
        raise NoAnswerError(
            ErrorCode.DEADLINE, "the deadline passed before anything was certified; allow more time", stopped=True
        )

    def stop(self) -> None:
        """End the process at once."""
        if self._process is None:
            return
        if not self._ended:
            signal.pidfd_send_signal(self._process, signal.SIGKILL)
            select.select([self._process], [], [], _END_SECONDS)  # until its memory is free
        os.close(self._process)
        self._pipe.close()
        self._life.close()
        self._process = None
        self.state.clear()

    @property
    def _ended(self) -> bool:
        return self._life.poll()  # the other end is never written to: readable means closed


def _pipe() -> tuple[Connection, Connection]:
    return tuple(Connection(end.detach()) for end in socket.socketpair())  # type: ignore[return-value]


def _fork_on_request(requests: socket.socket, make: Callable[..., Answering]) -> None:
    """The template: forks until its owner closes the socket or dies."""
    for number in (signal.SIGINT, signal.SIGTERM):  # of the process group; the owner ends it
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        request, ends, _, _ = socket.recv_fds(requests, 100_000, 2)
        if not request:
            os._exit(0)
        process = os.fork()
        if process == 0:
            requests.close()
            status = 1
            try:
                settings, memory = json.loads(request)
                _serve(Connection(ends[0]), Connection(ends[1]), make, settings, memory)
                status = 0
            finally:
                os._exit(status)
        for end in ends:
            os.close(end)
        requests.send(str(process).encode())


def _serve(pipe: Connection, life: Connection, make: Callable[..., Answering], settings: Any, memory: int) -> None:
    """The worker: answers until its owner closes the pipe or dies."""
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + memory, taken + memory))
    threading.Thread(target=_end_with, args=(life,), daemon=True).start()
    answer = make(*settings)
    pipe.send_bytes(b"ready")
    while True:
        try:
            header, messages = _received(pipe)
        except (EOFError, OSError):
            return
        _send(pipe, *answer(header, messages))


def _end_with(life: Connection) -> None:
    """End the process when the owner has closed its end, also in the middle of a computation."""
    life.poll(None)
    os._exit(0)


def _send(pipe: Connection, header: dict[str, Any], messages: Sequence[bytes]) -> None:
    pipe.send_bytes(json.dumps(header | {"messages": len(messages)}).encode())
    for message in messages:
        pipe.send_bytes(message)


def _received(pipe: Connection) -> Exchange:
    header = json.loads(pipe.recv_bytes())
    return header, [pipe.recv_bytes() for _ in range(header["messages"])]
