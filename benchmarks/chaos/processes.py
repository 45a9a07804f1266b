"""Nodes as real processes: started as `ros2 run` does, signalled, limited, and measured."""

import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 60.0
"""s after which what must come counts as not coming."""
TRANSPORT = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(ROOT / "config" / "localhost_udp.xml"),
}
_PAGE = resource.getpagesize()


def environment(domain: int, folder: Path) -> dict[str, str]:
    """What a fresh shell gives a node in this ROS domain."""
    values = dict(os.environ)
    values.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    values.pop("LD_LIBRARY_PATH", None)
    return values | {
        "AMENT_PREFIX_PATH": values.get("AMENT_PREFIX_PATH") or sys.prefix,
        **TRANSPORT,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_LOG_DIR": str(folder / "log"),
        "PYTHONUNBUFFERED": "1",
        "RCUTILS_COLORIZED_OUTPUT": "0",
    }


class NodeProgram:
    """One executable of the package, which can be started again.

    Args:
        name: of the executable.
        parameters: of the node.
        folder: for its parameter file and its output.
        domain: ROS domain.
        remaps: old name -> new name.
    """

    def __init__(
        self,
        name: str,
        parameters: Mapping[str, Any],
        folder: Path,
        domain: int,
        remaps: Mapping[str, str] | None = None,
    ) -> None:
        self.name, self.folder, self._domain = name, folder, domain
        self._remaps = [f"{old}:={new}" for old, new in (remaps or {}).items()]
        self._log = folder / f"{name}.txt"
        self.process: subprocess.Popen[bytes] | None = None
        self.parameters = dict(parameters)

    def start(self, full_disk: bool = False) -> None:
        """Start it; with `full_disk` every write to a file fails."""
        file = self.folder / f"{self.name}.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": self.parameters}}))
        leash = ["setpriv", "--pdeathsig", "KILL"] if shutil.which("setpriv") else []  # it ends with the benchmark
        command = [
            *leash,
            str(Path(sys.prefix) / "lib" / "poise" / self.name),
            "--ros-args",
            "--params-file",
            str(file),
        ]
        for remap in self._remaps:
            command += ["-r", remap]
        with self._log.open("ab") as sink:
            self.process = subprocess.Popen(
                command,
                env=environment(self._domain, self.folder),
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_no_space if full_disk else None,  # no other thread holds a lock here
            )

    @property
    def pid(self) -> int:
        """Of the process."""
        if self.process is None:
            raise ProcessLookupError(f"{self.name} was not started")
        return self.process.pid

    @property
    def is_running(self) -> bool:
        """It has not ended."""
        return self.process is not None and self.process.poll() is None

    @property
    def output(self) -> str:
        """Everything printed so far, by all its starts."""
        return self._log.read_text(errors="replace") if self._log.exists() else ""

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and those it started."""
        os.killpg(self.pid, number)

    def kill(self) -> None:
        """End it by SIGKILL, and wait; processes that it started go on."""
        if self.is_running:
            os.kill(self.pid, signal.SIGKILL)
        if self.process is not None:
            self.process.wait()

    def stop(self) -> int | None:
        """End it by Ctrl-C; returns the exit status, None when it hangs (then it is killed)."""
        if self.process is None:
            return 0
        if self.is_running:
            self.send(signal.SIGINT)
        try:
            return self.process.wait(15.0)
        except subprocess.TimeoutExpired:
            self.kill()
            return None

    def processes(self) -> list[int]:
        """Ids of the process and of those that it started, directly or not."""
        found = [self.pid]
        for process in found:  # grows while it is read
            for task in Path(f"/proc/{process}/task").iterdir():
                found += map(int, (task / "children").read_text().split())
        return found

    def memory(self) -> float:
        """Resident memory, MB."""
        return int(Path(f"/proc/{self.pid}/statm").read_text().split()[1]) * _PAGE / 1e6

    def processor_time(self) -> float:
        """s of the processor that it has used."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


NO_SPACE = 8
"""Bytes of the largest file on a full disk: memory that processes share is a file to this limit, of 8 bytes."""


def _no_space() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (NO_SPACE, NO_SPACE))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # the write fails, as on a full disk
