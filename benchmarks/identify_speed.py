"""CPU seconds of `identify` on a simulated minute of an FR3 with wrench and joint states at 1 kHz.

    python benchmarks/identify_speed.py           # a minute, seven runs
    python benchmarks/identify_speed.py --quick   # 10 s of recording, two runs

The recording is written once; each run reads it and identifies the payload, as `poise identify BAG` does without a
report. Exits with 1 when the median misses the goal. Writes out/benchmarks/identify_speed.json.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `poise` does

import numpy as np
from rich.console import Console
from rich.table import Table

from poise.files import write_whole
from poise.inertia import InertialParameters, identify
from poise.recording import open_recording, write_recording
from poise.robot import RobotModel, find_urdf, read_urdf
from poise.simulation import FourierTrajectory, IdealRobot, JointNoise, record, wrench_noise

ROOT = Path(__file__).resolve().parents[1]
GOAL = 1.0
"""CPU s for a minute; it took 11.5 s when the splines built their sparse matrices at each call."""
LOAD = InertialParameters(1.2, np.array([0.02, -0.03, 0.08]), np.diag([6e-3, 5e-3, 3e-3]))


def write_bag(path: Path, seconds: float, rate: float) -> None:
    """A simulated recording: a Fourier motion of an FR3 with 1.2 kg, encoder and sensor noise."""
    rng = np.random.default_rng(12)
    robot = RobotModel.from_file("fr3")
    motion = FourierTrajectory.random(robot, rng, duration=seconds)
    world = IdealRobot(robot, LOAD.phi)
    made = record(
        world, motion, rng, wrench_noise("moderate", rate=rate), JointNoise(rate=rate, position=2e-6), start=10**18
    )
    text = read_urdf(find_urdf("fr3"))
    write_recording(path, {"joint_states": made.joints, "wrench": made.wrench}, robot_description=text)


def main() -> int:
    """Measure; 0 when the goal is met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="10 s of recording, two runs")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "benchmarks" / "identify_speed.json")
    options = parser.parse_args()
    seconds, runs = (10.0, 2) if options.quick else (options.seconds, options.runs)
    times, mass = [], np.nan
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "minute.mcap"
        write_bag(bag, seconds, 1000.0)
        for _ in range(runs):
            began = time.process_time()
            mass = identify(open_recording(bag), keep_history=False).estimate.parameters.mass
            times.append(time.process_time() - began)
    median = float(np.median(times))
    table = Table("recording", "runs", "CPU s, median (least to most)", "goal", "mass")
    table.add_row(
        f"{seconds:.0f} s at 1 kHz",
        str(runs),
        f"{median:.2f} ({min(times):.2f} to {max(times):.2f})",
        f"{GOAL * seconds / 60:.2f}",
        f"{mass:.4f} kg (true {LOAD.mass:.4f})",
    )
    Console().print(table)
    write_whole(options.output, json.dumps({"seconds": seconds, "cpu": times, "mass": mass}, indent=1).encode())
    return 0 if median <= GOAL * max(seconds / 60, 1 / 6) else 1


if __name__ == "__main__":
    sys.exit(main())
