"""The whole graph at 1 kHz for a while: memory per hour, processor, and messages that are not accounted for.

    python -m benchmarks.chaos.soak                # one minute
    python -m benchmarks.chaos.soak --minutes 30

An arm (wrench and joint states at 1 kHz) feeds inertial_estimator and mismatch_diagnoser; a sensor in software feeds
ft_driver at 1 kHz; robustness_server is called ten times a second. Writes out/benchmarks/soak.json.
"""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rich.console import Console
from rich.table import Table

from benchmarks.chaos.observer import Observer
from benchmarks.chaos.processes import TRANSPORT, NodeProgram
from benchmarks.chaos.run import right_again
from benchmarks.chaos.subjects import AccelerationLimitsOfCube, Diagnoser, Driver, Estimator, Server, Subject

_RATE = 1000.0
_WARM = 0.4
"""Share of the time that is left out of the memory: buffers fill at first."""
_COUNTS = {
    "inertial_estimator": ("samples_used", "rejected_", "queue_overflows", "clock_jumps"),
    "ft_driver": ("received", "lost", "out_of_order", "duplicates", "withheld"),
}
"""How the names of counts on diagnostics begin, by node. ft_driver: received + lost is what the sensor has sent."""
_ARM = {"mode": "arm", "robot": "xarm7", "trajectory": "fourier", "duration": 60.0, "loop": True, "seed": 1}
_ARM |= {
    "sensor": "ft300",
    "sensor_rate": _RATE,
    "joint_rate": _RATE,
    "payload.mass": 0.8,
    "payload.com": [0.01, 0.0, 0.2],
}
_ARM |= {"payload.inertia": [0.003, 0.0, 0.0, 0.003, 0.0, 0.001]}


class Stream:
    """Messages of one topic, and how many are missing by their stamps."""

    def __init__(self) -> None:
        self._last = self.heard = self.missing = 0

    def take(self, message: Any) -> None:
        """Count one."""
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        between = round((stamp - self._last) * 1e-9 * _RATE) - 1
        if self._last and 0 < between < _RATE:  # more is a start again
            self.missing += between
        self._last = stamp
        self.heard += 1


class Counts:
    """What the diagnostics of the nodes that read streams say of their samples."""

    def __init__(self) -> None:
        self.values: dict[str, dict[str, int]] = {}

    def take(self, message: DiagnosticArray) -> None:
        """Remember the newest counts."""
        for status in message.status:
            name = status.name.partition(":")[0]
            wanted = _COUNTS.get(name, ())
            found = {pair.key: int(pair.value) for pair in status.values if pair.key.startswith(wanted)}
            if wanted and found:
                self.values[name] = found


def soak(minutes: float, domain: int) -> dict[str, Any]:
    """Run the graph; returns memory, processor and counts by name."""
    observer = Observer(domain, fast=True)
    sensor, server = Driver(), Server()
    subjects: list[Subject] = [sensor, Estimator(), Diagnoser(), server, AccelerationLimitsOfCube()]
    arm, counts = Stream(), Counts()
    observer.hear(WrenchStamped, "wrench", arm.take)
    observer.hear(DiagnosticArray, "/diagnostics", counts.take)
    with tempfile.TemporaryDirectory() as folder:
        programs = {"fake_robot": NodeProgram("fake_robot", _ARM, Path(folder), domain)}
        for subject in subjects:
            remaps = {"wrench": "sensor/wrench"} if subject.node == "ft_driver" else {}
            programs[subject.node] = NodeProgram(subject.node, subject.parameters(), Path(folder), domain, remaps)
        driver = Stream()
        observer.hear(WrenchStamped, "sensor/wrench", driver.take)
        for subject in subjects[1:]:
            subject.connect(observer)
        try:
            for program in programs.values():
                program.start()
            for subject in subjects[1:]:
                right_again(subject, observer)
            memory = _watch(observer, programs, server, minutes * 60.0)
            processor = {name: program.processor_time() for name, program in programs.items()}
            alive = {name: program.is_running for name, program in programs.items()}
        finally:
            for program in programs.values():
                program.stop()
            observer.close()
            for subject in subjects:
                subject.open.close()
    return {
        "memory": {name: _growth(rows) for name, rows in memory.items()},
        "processor": {name: used / (minutes * 60.0) for name, used in processor.items()},
        "alive": alive,
        "messages": {"arm": (arm.heard, arm.missing), "ft_driver": (driver.heard, driver.missing)},
        "counts": counts.values,
        "streams": sensor.streams,
        "false": [text for subject in subjects for text in subject.false],
    }


def _watch(
    observer: Observer, programs: dict[str, NodeProgram], server: Server, seconds: float
) -> dict[str, list[tuple[float, float]]]:
    """(s, MB) of every process, once a second."""
    memory: dict[str, list[tuple[float, float]]] = {name: [] for name in programs}
    begun = time.monotonic()
    while (now := time.monotonic() - begun) < seconds:
        for name, program in programs.items():
            memory[name].append((now, program.memory()))
        for _ in range(10):
            server.ask(observer, 30.0)
            observer.rest(0.1)
    return memory


def _growth(rows: list[tuple[float, float]]) -> tuple[float, float]:
    """Last memory, MB, and its slope after the warm-up, MB per hour."""
    at, memory = np.array(rows).T
    late = at > _WARM * at[-1]
    slope = np.polyfit(at[late], memory[late], 1)[0] if late.sum() > 2 else float("nan")
    return float(memory[-1]), float(slope * 3600.0)


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--domain", type=int, default=78)
    parser.add_argument("--quick", action="store_true", help="20 s")
    arguments = parser.parse_args()
    os.environ.update(TRANSPORT)
    found = soak(1 / 3 if arguments.quick else arguments.minutes, arguments.domain)
    table = Table("node", "alive", "memory, MB", "MB per hour", "cores")
    for name, (last, slope) in found["memory"].items():
        cores = f"{found['processor'][name]:.2f}"
        table.add_row(name, str(found["alive"][name]), f"{last:.0f}", f"{slope:+.1f}", cores)
    console = Console()
    console.print(table)
    for name, (heard, missing) in found["messages"].items():
        console.print(f"{name}: {heard} messages heard, {missing} missing by their stamps")
    console.print(f"ft_driver asked its sensor for {found['streams']} streams: samples between two were not sent")
    for name, values in found["counts"].items():
        console.print(f"{name} counts {values}")
    console.print(f"false answers: {len(found['false'])}")
    result = Path("out/benchmarks/soak.json")
    result.parent.mkdir(parents=True, exist_ok=True)
    result.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
