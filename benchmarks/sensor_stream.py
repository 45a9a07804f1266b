"""From sensor to subscriber: RDT at 7 kHz accounted for, silence and return, transport at 1 kHz.

    python benchmarks/sensor_stream.py            # what the README claims, about 6 minutes
    python benchmarks/sensor_stream.py --quick    # a slice of it, half a minute

Exits with 1 when a goal is missed. Writes out/benchmarks/sensor_stream.json.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from poise.force_torque.sensors.ati_rdt.fake import FakeRdtSensor
from poise.force_torque.wire import WrenchSource
from poise.nodes.runtime import EventsExecutor
from poise_msgs.msg import WrenchBatch

ROOT = Path(__file__).resolve().parents[1]
TRANSPORT_ENDS = Path(__file__).parent / "transport_ends.py"
PATIENCE = 20.0
"""s after which something that must come counts as not coming."""

TOPICS = ("wrench", "wrench_batch")

SILENCE_GOAL = 0.1
RETURN_GOAL = 1.0
P50_GOAL, P99_GOAL, CPU_GOAL = 0.3e-3, 1.5e-3, 0.15


class Goal(NamedTuple):
    """One line of the result."""

    name: str
    value: str
    goal: str
    met: bool


class Watch:
    """A node that watches the driver; its callbacks run inside `until` only."""

    def __init__(self) -> None:
        self.node = Node("watch")
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)
        self.diagnostics: list[dict[str, str]] = []
        self.node.create_subscription(DiagnosticArray, "diagnostics", self._diagnose, 100)

    def _diagnose(self, message: DiagnosticArray) -> None:
        self.diagnostics.append({pair.key: pair.value for pair in message.status[0].values})

    def until(self, condition: Callable[[], Any], timeout: float = PATIENCE) -> bool:
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()


@contextmanager
def driver(sensor: FakeRdtSensor, **parameters: object) -> Iterator[subprocess.Popen[bytes]]:
    """The real driver process on a sensor that is not there."""
    parameters = {"address": "127.0.0.1", "port": sensor.port, "http_port": sensor.http_port, **parameters}
    arguments = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    command = [sys.executable, "-m", "poise.nodes.ft_driver", "--ros-args", "--log-level", "fatal", *arguments]
    process = subprocess.Popen(command, start_new_session=True)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()


def cpu_seconds(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure_stream(watch: Watch, seconds: float, progress: Progress) -> dict[str, Any]:
    """RDT at 7 kHz: every sequence number received or reported lost, and what that costs."""
    task = progress.add_task("RDT at 7 kHz", total=seconds)
    batches: list[WrenchBatch] = []
    wrenches: list[WrenchStamped] = []
    subscriptions = [
        watch.node.create_subscription(WrenchBatch, "wrench_batch", batches.append, 1000),
        watch.node.create_subscription(WrenchStamped, "wrench", wrenches.append, 1000),
    ]
    watch.diagnostics.clear()
    with FakeRdtSensor(WrenchSource(np.ones(6)), rate=7000.0) as sensor:
        sensor.length = round(7000 * seconds)
        sensor.silent = True  # until the subscriptions are known to the driver
        # A sensor of this process that a busy machine holds up is not silent: the driver would start its stream again.
        with driver(sensor, publish_rate=1000.0, batch_rate=100.0, silence=2.0) as process:
            watch.until(lambda: watch.diagnostics and all(watch.node.count_publishers(t) for t in TOPICS))
            watch.until(lambda: False, timeout=1.0)
            sensor.silent = False
            watch.until(lambda: sensor.is_streaming)
            began, cpu = time.monotonic(), cpu_seconds(process.pid)
            while sensor.sent < sensor.length and time.monotonic() - began < seconds + PATIENCE:
                watch.until(lambda: sensor.sent >= sensor.length, timeout=0.5)
                progress.update(task, completed=sensor.sent / 7000)
            share = (cpu_seconds(process.pid) - cpu) / (time.monotonic() - began)
            watch.until(lambda: watch.diagnostics and watch.diagnostics[-1]["condition"] == "silent")
            received = int(watch.diagnostics[-1]["received"])
            watch.until(lambda: sum(len(batch.sequence) for batch in batches) >= received, timeout=2.0)
    for subscription in subscriptions:
        watch.node.destroy_subscription(subscription)
    counts = watch.diagnostics[-1]
    return {
        "sent": sensor.length,
        "received": received,
        "lost": int(counts["lost"]),
        "duplicates": int(counts["duplicates"]),
        "out_of_order": int(counts["out_of_order"]),
        "in_batches": sum(len(batch.sequence) for batch in batches),
        "wrenches": len(wrenches),
        "driver_cpu_share": share,
        "seconds": seconds,
    }


def measure_silence(watch: Watch, repeats: int, progress: Progress) -> dict[str, Any]:
    """A sensor falls silent and comes back, after a while that lets the driver's waits grow to their cap."""
    task = progress.add_task("silence and return", total=repeats)
    rng = np.random.default_rng(1)
    stamps: list[int] = []
    subscription = watch.node.create_subscription(
        WrenchStamped,
        "wrench",
        lambda message: stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec),
        1000,
    )
    silences, returns = [], []
    with FakeRdtSensor(WrenchSource(np.ones(6)), rate=1000.0) as sensor, driver(sensor):
        for _ in range(repeats):
            watch.until(lambda: bool(stamps) and time.time_ns() - stamps[-1] < 50_000_000)
            watch.diagnostics.clear()
            silent_at = time.monotonic()
            sensor.silent = True
            heard = watch.until(lambda: any(each["condition"] == "silent" for each in watch.diagnostics))
            silences.append(time.monotonic() - silent_at if heard else float("inf"))
            watch.until(lambda: False, timeout=rng.uniform(0.1, 2.5))
            sensor.power_cycle()
            back_at, back_at_ns = time.monotonic(), time.time_ns()
            sensor.silent = False
            back = watch.until(lambda since=back_at_ns: bool(stamps) and stamps[-1] > since)
            returns.append(time.monotonic() - back_at if back else float("inf"))
            progress.advance(task)
    watch.node.destroy_subscription(subscription)
    return {"repeats": repeats, "silence_s": silences, "return_s": returns}


def measure_transport(executor: str, seconds: float, progress: Progress) -> dict[str, Any]:
    """Two processes, WrenchStamped at 1 kHz; the subscriber spins as nodes/runtime does, or as rclpy.spin does."""
    task = progress.add_task(f"transport, {executor} executor", total=seconds)
    count = round(1000 * seconds)
    subscriber = subprocess.Popen(
        [sys.executable, TRANSPORT_ENDS, "subscribe", str(count), executor], stdout=subprocess.PIPE, text=True
    )
    publisher = subprocess.Popen([sys.executable, TRANSPORT_ENDS, "publish", str(count)])
    began = time.monotonic()
    try:
        while publisher.poll() is None and time.monotonic() - began < seconds + PATIENCE:
            time.sleep(0.2)
            progress.update(task, completed=min(seconds, time.monotonic() - began))
        output, _ = subscriber.communicate(timeout=PATIENCE)
    finally:
        for process in (publisher, subscriber):
            if process.poll() is None:
                process.kill()
    progress.update(task, completed=seconds)
    result: dict[str, Any] = json.loads(output)
    return result


def goals(results: dict[str, Any]) -> list[Goal]:
    """The claims, each with its number."""
    stream, silence = results["stream"], results["silence"]
    accounted = stream["received"] + stream["lost"]
    silences, returns = np.array(silence["silence_s"]), np.array(silence["return_s"])
    lines = [
        Goal(
            "RDT 7 kHz: received + lost = sent",
            f"{stream['received']} + {stream['lost']} = {accounted}",
            str(stream["sent"]),
            accounted == stream["sent"],
        ),
        Goal(
            "RDT 7 kHz: received, in batches at a subscriber",
            str(stream["in_batches"]),
            str(stream["received"]),
            stream["in_batches"] == stream["received"],
        ),
        Goal("RDT 7 kHz: share of a core", f"{stream['driver_cpu_share']:.1%}", "", True),
        Goal(
            "silence reported in time",
            f"{np.sum(silences <= SILENCE_GOAL)} of {len(silences)}, at the most {silences.max() * 1e3:.0f} ms",
            f"all, {SILENCE_GOAL * 1e3:.0f} ms",
            bool(np.all(silences <= SILENCE_GOAL)),
        ),
        Goal(
            "samples back in time",
            f"{np.sum(returns <= RETURN_GOAL)} of {len(returns)}, at the most {returns.max() * 1e3:.0f} ms",
            f"all, {RETURN_GOAL * 1e3:.0f} ms",
            bool(np.all(returns <= RETURN_GOAL)),
        ),
    ]
    for executor, transport in results["transport"].items():
        ours = executor == "events"  # the one of nodes/runtime; the other is there to compare with
        p50, p99 = transport["latency_p50"], transport["latency_p99"]
        goal = f"none, {P50_GOAL * 1e3} ms, {P99_GOAL * 1e3} ms, {CPU_GOAL:.0%}" if ours else ""
        met = transport["lost"] == 0 and p50 <= P50_GOAL and p99 <= P99_GOAL and transport["cpu_share"] <= CPU_GOAL
        lines.append(
            Goal(
                f"1 kHz, {executor} executor: lost, p50, p99, share of a core",
                f"{transport['lost']}, {p50 * 1e3:.3f} ms, {p99 * 1e3:.3f} ms, {transport['cpu_share']:.1%}",
                goal,
                met or not ours,
            )
        )
    return lines


def save(results: dict[str, Any], path: Path) -> None:
    """Write the results whole, or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".part")
    unfinished.write_text(json.dumps(results, indent=1))
    unfinished.replace(path)


def show(lines: list[Goal], console: Console) -> None:
    table = Table(title="From sensor to subscriber")
    for column in ("what", "measured", "goal", ""):
        table.add_column(column)
    for line in lines:
        table.add_row(line.name, line.value, line.goal, "[green]met" if line.met else "[red]missed")
    console.print(table)


def main() -> int:
    """Measure; 0 when every goal is met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=30.0, help="of every stream")
    parser.add_argument("--repeats", type=int, default=100, help="of silence and return")
    parser.add_argument("--quick", action="store_true", help="3 s and 3 repeats")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "benchmarks" / "sensor_stream.json")
    options = parser.parse_args()
    seconds, repeats = (3.0, 3) if options.quick else (options.seconds, options.repeats)

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", "77")
    console = Console(stderr=True)
    rclpy.init()
    watch = Watch()
    with Progress(console=console) as progress:
        results = {
            "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {platform.platform()}",
            "stream": measure_stream(watch, seconds, progress),
            "silence": measure_silence(watch, repeats, progress),
            "transport": {each: measure_transport(each, seconds, progress) for each in ("events", "single")},
        }
    watch.close()
    rclpy.try_shutdown()
    save(results, options.output)
    lines = goals(results)
    show(lines, Console())
    return 0 if all(line.met for line in lines) else 1


if __name__ == "__main__":
    sys.exit(main())
