"""Parsing of mesh files in a separate process with limited memory and time, so that a bad file cannot harm the caller.

A request is a line of JSON (format, name, size) and the file's bytes; an answer is a line of JSON and the two arrays.
"""

import json
import os
import resource
import select
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import BinaryIO

import numpy as np

import poise
from poise.errors import ErrorCode, InputError
from poise.shape.mesh_formats import MESH_READERS, Arrays
from poise.shape.stage_formats import STAGE_READERS

_MAX_MEMORY = 3_000_000_000
"""Bytes of address space; a file of 100 MB as text needs about half."""
_MAX_SECONDS = 60.0
_MAX_LINE = 100_000
_READERS = MESH_READERS | STAGE_READERS


class MeshWorker:
    """The process, started when the first file comes, and again after one has broken it."""

    def __init__(self, seconds: float = _MAX_SECONDS, memory: int = _MAX_MEMORY) -> None:
        self._seconds, self._memory = seconds, memory
        self._process: subprocess.Popen[bytes] | None = None
        self._one_at_a_time = threading.Lock()

    def parse(self, content: bytes, suffix: str, name: str) -> Arrays:
        """(V, 3) vertices and (T, 3) triangles of a file's content.

        Raises:
            InputError: what the reader of the format raises; MESH_INVALID when it needs too much time or memory.
        """
        with self._one_at_a_time:
            try:
                return self._ask(content, suffix, name)
            except (OSError, EOFError, TimeoutError) as error:
                self.stop()
                what = "time" if isinstance(error, TimeoutError) else "memory"
                message = f"{name}: reading it takes too much {what}; simplify the mesh and save it again"
                raise InputError(ErrorCode.MESH_INVALID, message) from error

    def stop(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    pipe.close()
            self._process = None

    def _ask(self, content: bytes, suffix: str, name: str) -> Arrays:
        if self._process is None or self._process.poll() is not None:
            self.stop()
            self._process = self._start()
        deadline = time.monotonic() + self._seconds
        stdin, stdout = self._process.stdin, self._process.stdout
        if stdin is None or stdout is None:
            raise EOFError
        request = {"suffix": suffix, "name": name, "size": len(content)}
        stdin.write(json.dumps(request).encode() + b"\n" + content)
        stdin.flush()
        line = b""
        while not line.endswith(b"\n") and len(line) < _MAX_LINE:
            line += _receive(stdout.fileno(), 1, deadline)
        answer = json.loads(line)
        if "code" in answer:
            raise InputError(ErrorCode(answer["code"]), answer["message"])
        vertices = _receive(stdout.fileno(), 24 * int(answer["vertices"]), deadline)
        triangles = _receive(stdout.fileno(), 24 * int(answer["triangles"]), deadline)
        return np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(triangles, np.int64).reshape(-1, 3)

    def _start(self) -> "subprocess.Popen[bytes]":
        above = str(Path(poise.__file__).resolve().parents[1])
        paths = os.pathsep.join([above, *filter(None, [os.environ.get("PYTHONPATH", "")])])
        environment = {**os.environ, "PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-P", "-m", "poise.shape.mesh_worker", str(self._memory)]
        pipe = subprocess.PIPE
        return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=environment)


def _receive(descriptor: int, size: int, deadline: float) -> bytes:
    parts, missing = [], size
    while missing:
        if not select.select([descriptor], [], [], max(0.0, deadline - time.monotonic()))[0]:
            raise TimeoutError
        part = os.read(descriptor, min(missing, 1 << 20))
        if not part:
            raise EOFError
        parts.append(part)
        missing -= len(part)
    return b"".join(parts)


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until there are none."""
    while line := requests.readline(_MAX_LINE):
        request = json.loads(line)
        content = requests.read(int(request["size"]))
        try:
            vertices, triangles = _READERS[request["suffix"]](content, request["name"])
        except InputError as error:
            answers.write(json.dumps({"code": int(error.code), "message": error.message}).encode() + b"\n")
        else:
            answers.write(json.dumps({"vertices": len(vertices), "triangles": len(triangles)}).encode() + b"\n")
            answers.write(np.ascontiguousarray(vertices, np.float64).tobytes())
            answers.write(np.ascontiguousarray(triangles, np.int64).tobytes())
        answers.flush()


if __name__ == "__main__":
    memory = int(sys.argv[1])
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    serve(sys.stdin.buffer, sys.stdout.buffer)
