"""Processes that do the work of a node: they are stopped at the deadline, also inside a native solver."""

import contextlib
import gc
import json
import os
import resource
import select
import signal
import socket
import struct
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
_READY = b"r"
"""What a worker sends when it has started: one byte, so that a wait for it leaves no part behind."""
_NEVER = float("inf")
_LEAST, _MOST = 1e-4, 1e6
"""s that a timeout may be."""
_PIECE = 1 << 20
"""Bytes received at a time."""

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
        self._requests = 0
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        gc.freeze()  # so that the collector does not copy pages of modules
        process = os.fork()
        if process == 0:
            self._socket.close()
            _fork_on_request(theirs, make)
        theirs.close()
        self._process = os.pidfd_open(process)

    def fork(self, settings: Any, pipe: socket.socket, life: Connection, due: float) -> int:
        """Start a worker with its ends of a socket and a pipe; its process id.

        Raises:
            NoAnswerError: DEADLINE when the template has not answered by `due`.
            PoiseError: INTERNAL when the template has ended.
        """
        if not self._lock.acquire(timeout=_left(due)):
            raise _late()
        try:
            self._requests += 1
            self._socket.settimeout(_left(due))
            request = json.dumps([self._requests, settings]).encode()
            socket.send_fds(self._socket, [request], [pipe.fileno(), life.fileno()])
            while answer := self._socket.recv(100):
                number, process = map(int, answer.split())
                if number == self._requests:  # else of a request that was given up: that worker ends with its pipes
                    return process
                self._socket.settimeout(_left(due))
        except TimeoutError as error:
            raise _late() from error
        except OSError:
            pass
        finally:
            self._lock.release()
        raise PoiseError(ErrorCode.INTERNAL, "the process that starts the workers has ended: restart the node")

    def close(self) -> None:
        """End the process, and wait for that; it starts no more workers."""
        with contextlib.suppress(OSError):  # it may have ended
            self._socket.shutdown(socket.SHUT_RDWR)
        if select.select([self._process], [], [], _END_SECONDS)[0]:
            with contextlib.suppress(ChildProcessError):  # closed before
                os.waitid(os.P_PIDFD, self._process, os.WEXITED)


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
    _begun: float | None = None
    """When its start began; None: it has started."""
    _stopping: Any = field(default_factory=threading.Lock)

    def start(self, due: float) -> None:
        """Start the process, unless it runs. A start that is not done by `due` goes on, for the next call.

        Raises:
            NoAnswerError: DEADLINE when it has not started by `due`, on the monotonic clock.
            PoiseError: INTERNAL when that fails.
        """
        if self._process is None or self._ended:
            self.stop()
            self._fork(due)
        if self._begun is None:
            return
        last = self._begun + _START_SECONDS
        try:
            _exactly(self._pipe, len(_READY), min(due, last))
        except EOFError as error:
            self.stop()
            raise PoiseError(ErrorCode.INTERNAL, "a worker ended while it started") from error
        except TimeoutError as error:
            if time.monotonic() < last:
                raise _late() from error
            self.stop()
            raise PoiseError(ErrorCode.INTERNAL, f"a worker did not start within {_START_SECONDS:g} s") from error
        self._begun = None

    def _fork(self, due: float) -> None:
        self._pipe, theirs = socket.socketpair()
        self._life, watched = _pipe()
        try:
            process = self.template.fork([list(self.settings), self.memory], theirs, watched, due)
            self._process = os.pidfd_open(process)
        finally:
            theirs.close()
            watched.close()
            if self._process is None:
                self._pipe.close()
                self._life.close()
        self.starts += 1
        self._begun = time.monotonic()

    def ask(self, header: dict[str, Any], messages: Sequence[bytes], due: float) -> Exchange:
        """Exchange with the process; it is stopped when it has not answered by `due` on the monotonic clock.

        Raises:
            NoAnswerError: DEADLINE; `stopped` when the process had the request and was stopped.
            PoiseError: INTERNAL when it ended by itself.
        """
        try:
            self.start(due)
            if time.monotonic() >= due:  # nothing was asked: the process stays
                raise _late()
            _send(self._pipe, header, messages, due)
            return _received(self._pipe, due)
        except TimeoutError as error:
            self.stop()
            raise _late(stopped=True) from error
        except (EOFError, OSError) as error:
            self.stop()
            raise PoiseError(
                ErrorCode.INTERNAL, "the worker ended during this call: it may need more memory than worker_memory"
            ) from error

    def stop(self) -> None:
        """End the process at once; from any thread."""
        with self._stopping:
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


def _late(stopped: bool = False) -> NoAnswerError:
    message = "the deadline passed before anything was certified; allow more time"
    return NoAnswerError(ErrorCode.DEADLINE, message, stopped=stopped)


def _pipe() -> tuple[Connection, Connection]:
    return tuple(Connection(end.detach()) for end in socket.socketpair())  # type: ignore[return-value]


def _fork_on_request(requests: socket.socket, make: Callable[..., Answering]) -> None:
    """The template: forks until its owner closes the socket or dies."""
    for ignored in (signal.SIGINT, signal.SIGTERM):  # of the process group; the owner ends it
        signal.signal(ignored, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        request, ends, _, _ = socket.recv_fds(requests, 100_000, 2)
        if not request:
            os._exit(0)
        number, (settings, memory) = json.loads(request)
        process = os.fork()
        if process == 0:
            requests.close()
            status = 1
            try:
                _serve(socket.socket(fileno=ends[0]), Connection(ends[1]), make, settings, memory)
                status = 0
            finally:
                os._exit(status)
        for end in ends:
            os.close(end)
        requests.send(f"{number} {process}".encode())


def _serve(pipe: socket.socket, life: Connection, make: Callable[..., Answering], settings: Any, memory: int) -> None:
    """The worker: answers until its owner closes the pipe or dies."""
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + memory, taken + memory))
    threading.Thread(target=_end_with, args=(life,), daemon=True).start()
    answer = make(*settings)
    pipe.sendall(_READY)
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


def _send(pipe: socket.socket, header: dict[str, Any], messages: Sequence[bytes], due: float = _NEVER) -> None:
    parts = [json.dumps(header).encode(), *messages]
    lengths = [len(part) for part in parts]
    for part in (struct.pack("<Q", len(parts)), struct.pack(f"<{len(parts)}Q", *lengths), *parts):
        pipe.settimeout(_left(due))
        pipe.sendall(part)


def _received(pipe: socket.socket, due: float = _NEVER) -> Exchange:
    (count,) = struct.unpack("<Q", _exactly(pipe, 8, due))
    lengths = struct.unpack(f"<{count}Q", _exactly(pipe, 8 * count, due))
    header, *messages = (_exactly(pipe, length, due) for length in lengths)
    return json.loads(header), messages


def _exactly(pipe: socket.socket, length: int, due: float) -> bytes:
    """The next bytes of a socket; TimeoutError when they have not come by `due`."""
    parts = []
    while length:
        pipe.settimeout(_left(due))
        part = pipe.recv(min(length, _PIECE))
        if not part:
            raise EOFError
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


def _left(due: float) -> float:
    """s until a time, as a timeout: 0 and infinity would have another meaning."""
    return min(max(due - time.monotonic(), _LEAST), _MOST)
