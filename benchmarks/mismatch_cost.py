"""CPU time of `poise mismatch` on one core, start of Python included: short, long and slow recordings.

    python -m benchmarks.mismatch_cost            # three figures with their spread, about four minutes
    python -m benchmarks.mismatch_cost --quick    # one recording of each kind, about one minute

The recordings are simulated: a UR10 with a payload in a Fourier motion, and one effect. Modules are compiled before, as
in a package that is installed. A machine that does other things adds to CPU times. Prints a table and writes
out/benchmarks/mismatch_cost.json. Exits with 1 when a median is above its goal.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from poise.files import write_whole
from poise.inertia import InertialParameters
from poise.mismatch.application import run_planned
from poise.mismatch.reading import ModelEffect, NominalModel, dump_model
from poise.recording import write_recording
from poise.robot import RobotModel, find_urdf, read_urdf
from poise.simulation import FourierTrajectory

ROBOT = "ridgeback_ur10"
HOME = np.array([0.0, 0.0, 0.0, 0.0, -1.9, 2.0, -1.67, -1.5708, 0.0])
REACH = np.array([0.0, 0.0, 0.0, 1.0, 0.4, 0.5, 0.9, 0.9, 1.4])
PAYLOAD = InertialParameters(2.0, np.array([0.01, -0.02, 0.08]), np.diag([0.008, 0.009, 0.006]))
EFFECTS: Mapping[str, Mapping[str, float]] = {
    "sensor_bias": {"force_x": 1.5, "force_y": 1.0, "force_z": 1.0, "torque_x": 0.1, "torque_y": 0.0, "torque_z": 0.0},
    "low_pass": {"time_constant": 0.06},
    "sensor_rotation": {"rotation_x": 0.03, "rotation_y": 0.0, "rotation_z": 0.02},
}
ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass(frozen=True)
class Kind:
    """Recordings of one length: s, rates in Hz, Hz of the motion's first harmonic, and the goal in s of CPU."""

    name: str
    seconds: float
    wrench_rate: float
    joint_rate: float
    frequency: float
    goal: float


KINDS = (
    Kind("35 s at 100 Hz, one effect", 35.0, 100.0, 125.0, 0.09, 2.0),
    Kind("10 min at 100 Hz", 600.0, 100.0, 100.0, 0.02, 20.0),
    Kind("175 s at 10 Hz", 175.0, 10.0, 50.0, 0.02, 3.0),
)


def main() -> int:
    """Measure; 0 when every goal is met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one recording of each kind")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/mismatch_cost.json"))
    options = parser.parse_args()
    names = list(EFFECTS)[:1] if options.quick else list(EFFECTS)
    console = Console()
    with tempfile.TemporaryDirectory() as compiled:
        environment = _environment(Path(compiled))
        measure(KINDS[0], names[0], 0, True, environment)
        found = _all(names, console, environment)
    write_whole(options.output, json.dumps(found, indent=1).encode())
    return int(any(each["median"] > each["goal"] for each in found.values()))


def _environment(compiled: Path) -> dict[str, str]:
    """Of the command: one core, and a folder for compiled modules."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | ONE_CORE | {"PYTHONPYCACHEPREFIX": str(compiled)}


def _all(names: Sequence[str], console: Console, environment: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Measure every kind of recording and print the table."""
    found: dict[str, dict[str, Any]] = {}
    table = Table("recording", "with", "CPU median, s", "range, s", "goal, s", "answers")
    for kind in KINDS:
        for efforts in (False, True):
            measured = [
                measure(kind, name, seed, efforts, environment)
                for seed, name in enumerate(track(names, kind.name, console=console, transient=True))
            ]
            times = [seconds for seconds, _ in measured]
            what = "wrench and efforts" if efforts else "wrench"
            found[f"{kind.name}, {what}"] = {"seconds": times, "median": statistics.median(times), "goal": kind.goal}
            spread = f"{min(times):.2f} to {max(times):.2f}"
            answers = ", ".join(sorted({answer for _, answer in measured}))
            table.add_row(kind.name, what, f"{statistics.median(times):.2f}", spread, f"{kind.goal:g}", answers)
    console.print(table)
    return found


def measure(kind: Kind, effect: str, seed: int, efforts: bool, environment: Mapping[str, str]) -> tuple[float, str]:
    """CPU seconds of one run of the command, user and system, and its verdict."""
    with tempfile.TemporaryDirectory() as folder:
        bag, model, answer = (Path(folder) / name for name in ("recording.mcap", "model.yaml", "answer.json"))
        make(kind, effect, seed, efforts, bag, model)
        words = ("mismatch", bag, "--model", model, "--json", answer)
        command = [sys.executable, "-m", "poise.cli", *map(str, words)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if not answer.exists():
            raise RuntimeError(done.stderr)
        content: dict[str, Any] = json.loads(answer.read_text())
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, str(content["verdict"])


def make(kind: Kind, effect: str, seed: int, efforts: bool, bag: Path, model: Path) -> None:
    """Write a recording with an effect, and the nominal model without it."""
    rng = np.random.default_rng(seed)
    robot = RobotModel.from_file(ROBOT, "ft_sensor")
    drawn = FourierTrajectory.random(
        robot, rng, duration=kind.seconds, speed=0.4, amplitude=1.0, frequency=kind.frequency, harmonics=5, centre=HOME
    )
    motion = replace(drawn, sine=drawn.sine * REACH, cosine=drawn.cosine * REACH)
    nominal = NominalModel(sensor_frame="ft_sensor", phi=PAYLOAD.phi)
    true = replace(nominal, effects=(ModelEffect(effect, dict(EFFECTS[effect]), np.zeros((0, 0))),))
    run = run_planned(robot, motion, true, rng, wrench_rate=kind.wrench_rate, joint_rate=kind.joint_rate)
    streams = dict(run.streams)
    if run.joints is not None and not efforts:
        streams["joint_states"] = replace(run.joints, effort=np.full(run.joints.effort.shape, np.nan))
    write_recording(bag, streams, robot_description=read_urdf(find_urdf(ROBOT)))
    model.write_text(dump_model(nominal), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
