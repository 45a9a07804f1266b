"""A fleet over two months: does `poise evaluate mismatch` say which joint of which robot changed, and when?

    python benchmarks/fleet.py [--quick] [--picture docs/pictures/evaluate.png]

Three robots of the kind of examples/arm are recorded each fourth day of April and May 2026. All have friction that the
model lacks, with a scatter of 5 % from day to day. The dry friction of the wrist of robot_7 doubles on 4 May.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from poise.evaluation import JOBS, changes, columns_of, measures_in, outliers, rows_of
from poise.recording import JointStream, write_recording
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory, IdealRobot
from poise.viewing import write_picture
from poise.viewing.evaluation_figures import change_panel, distribution_panel

ROOT = Path(__file__).resolve().parents[1]
URDF = ROOT / "examples" / "arm" / "arm.urdf"
ROBOTS = ("robot_5", "robot_6", "robot_7")
APRIL, DAY = datetime(2026, 4, 1, 9, tzinfo=UTC).timestamp(), 86400.0
CHANGED = datetime(2026, 5, 4, tzinfo=UTC).timestamp()
DRY, DAMPING = np.array([1.8, 0.9, 0.25]), np.array([0.9, 0.5, 0.12])
RATE, SECONDS, CREEP = 100.0, 12.0, 0.02


def make_recording(path: Path, robot: str, when: float, rng: np.random.Generator) -> None:
    """Joint states with efforts of one robot on one day."""
    model = RobotModel.from_file(URDF, "tool")
    motion = FourierTrajectory.random(model, rng, duration=SECONDS, speed=0.8)
    times = np.arange(int(SECONDS * RATE)) / RATE
    state = motion.at(times)
    dry = DRY * np.array([1.0, 1.0, 2.0 if robot == "robot_7" and when >= CHANGED else 1.0])
    scatter = 1.0 + 0.05 * rng.normal(size=(2, 3))
    effort = IdealRobot(model, np.zeros(10)).effort(state)
    effort = effort + dry * scatter[0] * np.tanh(state.velocity / CREEP) + DAMPING * scatter[1] * state.velocity
    effort += rng.normal(scale=0.01 * np.abs(effort).max(axis=0), size=effort.shape)
    stamps = np.round((when + times) * 1e9).astype(np.int64)
    joints = JointStream(stamps, model.joint_names, state.position, state.velocity, effort)
    write_recording(path, {"joint_states": joints}, robot_description=URDF.read_text())


def main() -> None:
    """Make the fleet, evaluate it, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="robot_7 alone")
    parser.add_argument("--picture", type=Path, help="draw the changes and distributions")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, rng, start = Path(name), np.random.default_rng(20), time.perf_counter()
        for robot in ROBOTS[-1:] if options.quick else ROBOTS:
            (folder / "fleet" / robot).mkdir(parents=True)
            for day in range(0, 61, 4):
                make_recording(folder / "fleet" / robot / f"day_{day:02}.mcap", robot, APRIL + day * DAY, rng)
        words = ["evaluate", "mismatch", f"{folder}/fleet/**/*.mcap", "--results", str(folder / "out")]
        subprocess.run([sys.executable, "-m", "poise.cli", *words], check=True)
        lines = (folder / "out" / "journal.jsonl").read_text().splitlines()[1:]
    entries = [json.loads(line) for line in lines]
    rows = rows_of(entries, {entry["name"]: Path(entry["name"]).parent.name for entry in entries})
    measures = measures_in(columns_of(rows), JOBS["mismatch"].measures)
    found = changes(rows, measures)
    print(f"{len(rows)} recordings in {time.perf_counter() - start:.0f} s, {len(measures)} quantities of each robot")
    for change in found:
        print(change.sentence)
    print(f"{len(outliers(rows, measures))} outliers")
    if options.picture is not None:
        shown = [change_panel(number, change) for number, change in enumerate(found[:2])]
        histograms = [distribution_panel(number, column, rows) for number, column in enumerate(measures)]
        write_picture([*shown, *(panel for panel in histograms if panel is not None)][:4], options.picture, columns=2)


if __name__ == "__main__":
    main()
