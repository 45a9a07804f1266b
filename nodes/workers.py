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
from pathlib import Path
from typing import Any

from poise.errors import ErrorCode, NoAnswerError, PoiseError
from poise.memory import release_memory

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
NOTHING_IN_TIME = "the deadline passed before anything was certified; allow more time"
"""Message of a call that is answered DEADLINE without a result."""

Header = dict[str, Any]
"""Plain values, for JSON."""
Exchange = tuple[Header, list[bytes]]
"""A header, and serialized messages."""
Answering = Callable[[Header, list[bytes]], Exchange]


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

    def fork(self, settings: Any, pipe: socket.socket, due: float) -> int:
        """Start a worker with its end of a socket; its process id.

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
            socket.send_fds(self._socket, [request], [pipe.fileno()])
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
        nice: how much it leaves the processor to others, as of `nice`.
    """

    template: WorkerTemplate
    settings: Sequence[Any]
    memory: int
    nice: int = 0
    starts: int = 0
    state: dict[str, Any] = field(default_factory=dict)
    """What its owner knows about the process of the moment; empty after a start."""
    _process: int | None = None
    _pipe: Any = None
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
            self._pipe.settimeout(_left(min(due, last)))
            if not self._pipe.recv(len(_READY)):
                self.stop()
                raise PoiseError(ErrorCode.INTERNAL, "a worker ended while it started")
        except TimeoutError as error:
            if time.monotonic() < last:
                raise _late() from error
            self.stop()
            raise PoiseError(ErrorCode.INTERNAL, f"a worker did not start within {_START_SECONDS:g} s") from error
        self._begun = None

    def _fork(self, due: float) -> None:
        self._pipe, theirs = socket.socketpair()
        try:
            process = self.template.fork([list(self.settings), self.memory, self.nice], theirs, due)
            self._process = os.pidfd_open(process)
        finally:
            theirs.close()
            if self._process is None:
                self._pipe.close()
        self.starts += 1
        self._begun = time.monotonic()

    def ask(self, header: Header, messages: Sequence[bytes], due: float) -> Exchange:
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
            self._process = None
            self.state.clear()

    @property
    def _ended(self) -> bool:
        return bool(select.select([self._process], [], [], 0.0)[0])


def _late(stopped: bool = False) -> NoAnswerError:
    return NoAnswerError(ErrorCode.DEADLINE, NOTHING_IN_TIME, stopped=stopped)


def _fork_on_request(requests: socket.socket, make: Callable[..., Answering]) -> None:
    """The template: forks until its owner closes the socket or dies."""
    for ignored in (signal.SIGINT, signal.SIGTERM):  # of the process group; the owner ends it
        signal.signal(ignored, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        request, ends, _, _ = socket.recv_fds(requests, 100_000, 1)
        if not request:
            os._exit(0)
        number, (settings, memory, nice) = json.loads(request)
        process = os.fork()
        if process == 0:
            requests.close()
            status = 1
            try:
                _serve(socket.socket(fileno=ends[0]), make, settings, memory, nice)
                status = 0
            finally:
                os._exit(status)
        for end in ends:
            os.close(end)
        requests.send(f"{number} {process}".encode())


def _serve(pipe: socket.socket, make: Callable[..., Answering], settings: Any, memory: int, nice: int) -> None:
    """The worker: answers until its owner closes the pipe or dies."""
    os.nice(nice)
    release_memory()  # what the owner has freed is no room for the worker beyond its bound
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + memory, taken + memory))
    threading.Thread(target=_end_with, args=(pipe.fileno(),), daemon=True).start()
    answer = make(*settings)
    pipe.sendall(_READY)
    while True:
        try:
            header, messages = _received(pipe)
        except (EOFError, OSError):
            return
        _send(pipe, *answer(header, messages))


def _end_with(pipe: int) -> None:
    """End the process when the owner has closed its end of a socket, also in the middle of a computation."""
    hung_up = select.poll()
    hung_up.register(pipe, 0)
    hung_up.poll()
    os._exit(0)


def _send(pipe: socket.socket, header: Header, messages: Sequence[bytes], due: float = _NEVER) -> None:
    """Send the number of parts, their lengths, and the parts: the header as JSON, then the messages."""
    parts = [json.dumps(header).encode(), *messages]
    begin = struct.pack(f"<{len(parts) + 1}Q", len(parts), *map(len, parts))
    pipe.settimeout(_left(due))
    pipe.sendall(b"".join((begin, *parts)))


def _received(pipe: socket.socket, due: float = _NEVER) -> Exchange:
    """What `_send` sent. No more than one exchange is under way, so that more than was asked for may be read."""
    data, place = bytearray(), 0

    def take(length: int) -> bytes:
        nonlocal place
        while len(data) < place + length:
            pipe.settimeout(_left(due))
            piece = pipe.recv(_PIECE)
            if not piece:
                raise EOFError
            data.extend(piece)
        place += length
        return bytes(memoryview(data)[place - length : place])

    (count,) = struct.unpack("<Q", take(8))
    lengths = struct.unpack(f"<{count}Q", take(8 * count))
    header, *messages = map(take, lengths)
    return json.loads(header), messages


def _left(due: float) -> float:
    """s until a time, as a timeout: 0 and infinity would have another meaning."""
    return min(max(due - time.monotonic(), _LEAST), _MOST)
