"""Worker processes: each answers one task after another, within bounds of time and memory; one that dies is replaced.

A worker is a process that reads tasks as lines of JSON from its stdin and writes replies as lines to its stdout. The
same workers serve local runs and the machines of a cluster.
"""

import atexit
import contextlib
import json
import os
import selectors
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from poise.errors import ErrorCode
from poise.evaluation.build import this_build

_ATTEMPTS = 2
"""Times that a task is given to a worker; a task that ends two workers is the cause."""
_CHUNK = 1 << 20


@dataclass(frozen=True)
class WorkerLimits:
    """Bounds of one worker.

    Args:
        seconds: for one task.
        memory: bytes of the process; 0: no bound.
    """

    seconds: float
    memory: int


@dataclass(frozen=True)
class WorkerTask:
    """One question to a worker.

    Args:
        job: subcommand of poise.
        arguments: of the subcommand, without the source.
        source: path or URL.
        folder: working directory that relative paths belong to.
        limits: of the worker.
        build: of the Poise that asks; another one refuses to answer.
        command: that starts a worker, on its own machine.
    """

    job: str
    arguments: tuple[str, ...]
    source: str
    folder: str
    limits: WorkerLimits
    build: str
    command: tuple[str, ...]


class WorkerEndedError(Exception):
    """The process of a worker ended without a reply."""


class WorkerProcess:
    """One process that answers tasks.

    Args:
        command: that starts it.
        memory: bytes that it may use; 0: no bound.
    """

    def __init__(self, command: Sequence[str], memory: int) -> None:
        single = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        self._process = subprocess.Popen(
            [*command, str(memory)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**os.environ, **single}
        )

    def ask(self, task: WorkerTask) -> dict[str, Any]:
        """The reply to a task.

        Raises:
            WorkerEndedError: the process died.
            TimeoutError: the time of the task is over; the process is then ended.
        """
        try:
            line = json.dumps(asdict(task)).encode() + b"\n"
            stdin = self._process.stdin
            if stdin is not None:
                stdin.write(line)
                stdin.flush()
            return json.loads(self._read_line(time.monotonic() + task.limits.seconds))  # type: ignore[no-any-return]
        except (BrokenPipeError, ConnectionError, ValueError) as error:
            raise WorkerEndedError(self.end()) from error
        except TimeoutError:
            self.end()
            raise

    def _read_line(self, deadline: float) -> bytes:
        stdout, received = self._process.stdout, bytearray()
        if stdout is None:
            raise BrokenPipeError
        with selectors.DefaultSelector() as selector:
            selector.register(stdout, selectors.EVENT_READ)
            while not received.endswith(b"\n"):
                if not selector.select(max(deadline - time.monotonic(), 0.0)):
                    raise TimeoutError
                if not (chunk := os.read(stdout.fileno(), _CHUNK)):
                    raise BrokenPipeError
                received += chunk
        return bytes(received)

    def kill(self) -> None:
        """Kill the process; a thread that waits for its reply then ends it."""
        self._process.kill()
        self._process.wait()

    def end(self) -> str:
        """End the process; how it ended, in words."""
        ended_by_itself = self._process.poll()
        self._process.kill()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):  # what was not sent is lost with it
                    pipe.close()
        status = self._process.wait() if ended_by_itself is None else ended_by_itself
        return f"signal {-status}" if status < 0 else f"exit status {status}"


class Workers:
    """Worker processes of this process: one for each thread that asks."""

    def __init__(self) -> None:
        self._own = threading.local()
        self._all: list[WorkerProcess] = []
        self._lock = threading.Lock()
        self._closed = False

    def answer(self, task: WorkerTask) -> dict[str, Any]:
        """The reply to a task; a process that dies is replaced once, one that is late is ended and reported."""
        how = ""
        for _ in range(_ATTEMPTS):
            try:
                return self._process(task).ask(task)
            except TimeoutError:
                self._own.process = None
                limit = f"{task.limits.seconds:g} s"
                return failed(ErrorCode.DEADLINE, f"{task.source}: no answer within {limit}; raise --time-limit")
            except WorkerEndedError as error:
                self._own.process, how = None, str(error)
        message = f"{task.source}: the worker process ended twice ({how}); is there enough memory?"
        return failed(ErrorCode.INTERNAL, message)

    def _process(self, task: WorkerTask) -> WorkerProcess:
        process: WorkerProcess | None = getattr(self._own, "process", None)
        if process is None:
            with self._lock:
                if self._closed:
                    raise WorkerEndedError("closed")
                process = self._own.process = WorkerProcess(task.command, task.limits.memory)
                self._all.append(process)
        return process

    def close(self) -> None:
        """Kill all processes; threads that wait for one see its end, and get no answer."""
        with self._lock:
            self._closed = True
            for process in self._all:
                process.kill()


def failed(code: ErrorCode, message: str, exit_status: int = 2) -> dict[str, Any]:
    """The reply that there is no answer."""
    error = {"code": int(code), "name": code.name, "message": message, "exit_status": exit_status}
    return {"answer": None, "error": error, "build": this_build()}


_WORKERS = Workers()
"""Of a process of a cluster, whose threads come and go with its tasks."""
atexit.register(_WORKERS.close)


def answer_on_cluster(task: WorkerTask) -> dict[str, Any]:
    """The reply of a worker of the machine that this runs on."""
    return _WORKERS.answer(task)
