"""The nodes of the loop as processes: started, started again when they end, and stopped."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from poise.errors import ErrorCode, InputError
from poise.nodes.loop_sequence import LoopOverError

_MOST_STARTS = 5
"""Of one node, then it is left: something is wrong with it that another start does not change."""
_STOPPING = 10.0
"""s that a node has to stop."""


class NodeProcesses:
    """Executables of the package, each one process with the same parameter files.

    Args:
        names: of the executables; each is also the name of its node.
        parameter_files: for all of them.
        folder: for what they print, one file each.
        domain: ROS domain; None: that of the environment.
        keep: names that are not started again, because their state ends with them.
        extra: parameters of single nodes, by node and name.
    """

    def __init__(
        self,
        names: Sequence[str],
        parameter_files: Sequence[Path],
        folder: Path,
        domain: int | None = None,
        keep: Sequence[str] = (),
        extra: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        self._files, self._folder, self._keep, self._extra = parameter_files, folder, tuple(keep), extra or {}
        self._environment = dict(os.environ)
        self._environment.setdefault("AMENT_PREFIX_PATH", sys.prefix)
        if self._environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None):  # re-execution of this very process
            self._environment.pop("LD_LIBRARY_PATH", None)
        if domain is not None:
            self._environment["ROS_DOMAIN_ID"] = str(domain)
        self.starts = dict.fromkeys(names, 0)
        """How often each was started."""
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self) -> None:
        """Start all.

        Raises:
            InputError: FILE_UNREADABLE when an executable is not installed.
        """
        for name in self.starts:
            self._start(name)

    def check(self) -> list[str]:
        """Start again what has ended; the names.

        Raises:
            LoopOverError: TOPIC_MISSING for one that is not started again.
        """
        ended = [name for name, process in self._running.items() if process.poll() is not None]
        for name in ended:
            status = self._running[name].returncode
            if name in self._keep or self.starts[name] >= _MOST_STARTS:
                del self._running[name]
                what = f"{name} has ended (exit status {status}) and is not started again; see {self._log(name)}"
                raise LoopOverError(ErrorCode.TOPIC_MISSING, what)
            self._start(name)
        return ended

    def stop(self) -> None:
        """Stop all, by force when they do not within a time."""
        for process in self._running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        until = time.monotonic() + _STOPPING
        for process in self._running.values():
            try:
                process.wait(max(until - time.monotonic(), 0.1))
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        self._running.clear()

    def process_of(self, name: str) -> subprocess.Popen[bytes] | None:
        """The running process of a node."""
        return self._running.get(name)

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _start(self, name: str) -> None:
        command = [str(_executable(name)), "--ros-args"]
        if shutil.which("setpriv"):  # however this process ends, the node ends with it
            command = ["setpriv", "--pdeathsig", "INT", *command]
        for file in self._files:
            command += ["--params-file", str(file)]
        for parameter, value in self._extra.get(name, {}).items():
            command += ["-p", f"{parameter}:={value}"]
        with self._log(name).open("ab") as sink:
            self._running[name] = subprocess.Popen(
                command,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C reaches this process alone, which brings the robot to rest first
            )
        self.starts[name] += 1


def _executable(name: str) -> Path:
    for folder in (Path(sys.prefix) / "lib" / "poise", Path(sys.prefix) / "bin"):
        if (folder / name).is_file():
            return folder / name
    found = shutil.which(name)
    if found is None:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"the node {name} is not installed: install Poise with its nodes")
    return Path(found)
