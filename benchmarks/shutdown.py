"""Ctrl-C once, Ctrl-C twice, SIGTERM and kill -9 of every node: clean exit or clean restart, nothing left running."""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

NODES: dict[str, list[str]] = {
    "ft_driver": ["-p", "device:=rdt", "-p", "address:=127.0.0.1"],
    "inertial_estimator": [],
    "placement_planner": [],
    "robustness_server": [],
    "acceleration_limits": [],
    "fake_robot": ["-p", "mode:=arm"],
    "mismatch_diagnoser": [],
}
WAYS = ("Ctrl-C", "Ctrl-C twice", "SIGTERM", "kill -9 and restart")
PATIENCE = 60.0  # s before a node that does not end counts as hanging


def start(name: str, domain: int, log: Path) -> subprocess.Popen[bytes]:
    environment = os.environ | {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "AMENT_PREFIX_PATH": sys.prefix,
        "ROS_LOG_DIR": str(log.parent),
    }
    environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    environment.pop("LD_LIBRARY_PATH", None)
    command = [Path(sys.prefix) / "lib" / "poise" / name, "--ros-args", *NODES[name]]
    with log.open("wb") as sink:
        return subprocess.Popen(command, env=environment, stdout=sink, stderr=subprocess.STDOUT, start_new_session=True)


def wait_until_running(process: subprocess.Popen[bytes], log: Path) -> None:
    """The node has its signal handlers once rclpy has opened its log file."""
    deadline = time.monotonic() + PATIENCE
    while process.poll() is None and time.monotonic() < deadline:
        if any(log.parent.glob("*.log")):
            time.sleep(0.3)  # past the constructor, into spinning
            return
        time.sleep(0.02)


def ends(group: int) -> bool:
    """Children end when they notice that the node has; on a busy machine that takes a moment."""
    deadline = time.monotonic() + 10.0
    while not group_is_empty(group):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def group_is_empty(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


def fault_of(name: str, way: str, domain: int) -> str:
    """Start, stop in this way, and say what went wrong ("" when nothing did)."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "output.txt"
        process = start(name, domain, log)
        wait_until_running(process, log)
        try:
            if way.startswith("kill"):
                os.killpg(process.pid, signal.SIGKILL)
                process.wait(PATIENCE)
                return fault_of(name, "Ctrl-C", domain)
            number = signal.SIGTERM if way == "SIGTERM" else signal.SIGINT
            os.killpg(process.pid, number)
            if way == "Ctrl-C twice":
                time.sleep(0.02)
                if process.poll() is None:
                    os.killpg(process.pid, number)
            status = process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            return "hangs"
        finally:
            left_running = not ends(process.pid)
            if left_running:
                os.killpg(process.pid, signal.SIGKILL)
        output = log.read_text(errors="replace")
    if left_running:
        return "left a process running"
    if "Traceback" in output:
        return f"traceback: {output.strip().splitlines()[-1]}"
    return "" if status == 0 else f"exit status {status}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=50)
    parser.add_argument("--domain", type=int, default=88)
    parser.add_argument("--quick", action="store_true", help="one repeat, and two of the ways for each node")
    arguments = parser.parse_args()
    repeats = 1 if arguments.quick else arguments.repeats
    table = Table(title=f"Clean of {repeats}")
    for heading in ("node", *WAYS):
        table.add_column(heading)
    ways = {name: WAYS[i % 2 :: 2] if arguments.quick else WAYS for i, name in enumerate(NODES)}
    cases = [(name, way) for name in NODES for way in ways[name]]
    faults = {case: [] for case in cases}
    for name, way in track([case for case in cases for _ in range(repeats)], description="stopping nodes"):
        faults[name, way] += [fault] if (fault := fault_of(name, way, arguments.domain)) else []
    for name in NODES:
        table.add_row(name, *(f"{repeats - len(faults[name, way])}" if way in ways[name] else "" for way in WAYS))
    console = Console()
    console.print(table)
    for (name, way), found in faults.items():
        for fault in sorted(set(found)):
            console.print(f"{name}, {way}: {found.count(fault)} x {fault}")
    result = Path("out/benchmarks/shutdown.json")
    result.parent.mkdir(parents=True, exist_ok=True)
    result.write_text(json.dumps({f"{name}: {way}": found for (name, way), found in faults.items()}, indent=1))
    sys.exit(any(faults.values()))


if __name__ == "__main__":
    main()
