"""Does the diagnoser keep up with a running robot? Its share of a core at 1 kHz, messages and examinations included.

    python benchmarks/live_mismatch.py            # what docs/mismatch.md says, three minutes
    python benchmarks/live_mismatch.py --rate 100
    python benchmarks/live_mismatch.py --efforts  # without a wrench

A fake robot moves an arm with a payload, wrench and joint states with efforts at 1 kHz; the node examines the last 35 s
again and again, as its defaults have it. Exits with 1 when it takes more than half a core, examines nothing or loses
messages. Writes out/benchmarks/live_mismatch.json.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from live_estimator import cpu_seconds
from rclpy.qos import qos_profile_sensor_data

from poise.files import write_whole

ROOT = Path(__file__).resolve().parents[1]
GOAL = 0.5
"""Share of a core."""
FILLING = 45.0
"""s until the node's window of 35 s is full."""
DOMAIN = "79"


def main() -> int:
    """Measure; 0 when the goal is met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=90.0, help="that are measured")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "benchmarks" / "live_mismatch.json")
    parser.add_argument("--rate", type=float, default=1000.0, help="Hz of wrench and joint states")
    parser.add_argument("--efforts", action="store_true", help="no wrench is published")
    options = parser.parse_args()
    os.environ |= {"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    arm = {"mode": "arm", "trajectory": "fourier", "duration": FILLING + options.seconds + 30.0, "sensor": "moderate"}
    arm |= {"sensor_rate": options.rate, "joint_rate": options.rate, "payload.mass": 1.5}
    arm |= {"wait_for_subscribers": "[joint_states]"}
    said = [word for name, value in arm.items() for word in ("-p", f"{name}:={value}")]
    said += ["-r", "wrench:=another_wrench"] if options.efforts else []
    node = subprocess.Popen([sys.executable, "-m", "poise.nodes.mismatch_diagnoser"])
    robot = subprocess.Popen([sys.executable, "-m", "poise.fake_robots.fake_robot_node", "--ros-args", *said])
    try:
        listened(FILLING)
        before, began = cpu_seconds(node.pid), time.monotonic()
        values = listened(options.seconds)
        share = (cpu_seconds(node.pid) - before) / (time.monotonic() - began)
    finally:
        for process in (robot, node):
            process.terminate()
            process.wait(20.0)
    found = {"share_of_a_core": share, **{key: float(value) for key, value in values.items()}}
    write_whole(options.output, json.dumps(found, indent=1).encode())
    print(json.dumps(found, indent=1))
    kept_up = found.get("examinations", 0) >= 2 and found.get("window_seconds", 0) > 30 and not found["late_messages"]
    return 0 if share < GOAL and kept_up else 1


def listened(seconds: float) -> dict[str, str]:
    """What the node last said of itself within some seconds."""
    rclpy.init()
    heard: dict[str, str] = {}
    watcher = rclpy.create_node("watcher")

    def take(message: DiagnosticArray) -> None:
        for status in message.status:
            if "mismatch_diagnoser" in status.name:
                heard.update({value.key: value.value for value in status.values})

    watcher.create_subscription(DiagnosticArray, "diagnostics", take, qos_profile_sensor_data)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(watcher, timeout_sec=0.2)
    watcher.destroy_node()
    rclpy.shutdown()
    return heard


if __name__ == "__main__":
    sys.exit(main())
