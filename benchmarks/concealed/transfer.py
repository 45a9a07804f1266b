"""Is a diagnosis of use? `python -m benchmarks.concealed.transfer`: flaws found with one load, then another is weighed.

Of each flaw MuJoCo makes two recordings, of two loads and two motions of one robot. `poise mismatch --save` sees the
first with its load known; `poise identify` weighs the second without and with the model that was saved.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.concealed.case import Case, Label, model_of, usual_motion
from benchmarks.concealed.changes import EVERYTHING
from benchmarks.concealed.changes.base import Change
from benchmarks.concealed.changes.honest import honest_errors
from benchmarks.concealed.engine import Engine
from benchmarks.concealed.payload import Payload
from benchmarks.concealed.recorder import Equipment, record
from benchmarks.concealed.scene import Scene
from poise.cli import run

FLAWS = (
    "low_pass",
    "world_force",
    "sensor_rotation",
    "joint_offset",
    "base_tilt",
    "clock_offset",
    "sensor_gain",
    "cable",
)
SEED = 5_501


def two_recordings(name: str, repeat: int, folder: Path) -> Payload:
    """Write first.mcap, first.yaml and second.mcap; the true load of the second."""
    seed = (SEED, repeat)
    flaw: Change | None = None
    true = Payload.random(np.random.default_rng([*seed, 0]))
    for number, stem in enumerate(("first", "second")):
        for_scene = np.random.default_rng([*seed, 1, number])
        declared, motion = Payload.random(for_scene), usual_motion((name,), for_scene)
        flaw = flaw or EVERYTHING[name](Scene(declared, motion), 1.0, np.random.default_rng([*seed, 2]))
        true, every = declared, [*honest_errors(np.random.default_rng([*seed, 3]), frozenset(flaw.settles)), flaw]
        for change in every:
            true = change.carry(true)
        engine = Engine(true, motion, [flaw])
        chance = np.random.default_rng([*seed, 4, number])
        recorded = record(engine, engine.run(), every, Equipment(effort=False, imu=False), chance, False)
        Case(recorded, model_of(declared, with_noise=False), Label("transfer", 1.0)).write(folder, stem)
    return true


def weighed(folder: Path, true: Payload, *more: str) -> tuple[float, float]:
    """Errors of the second recording's load: mass in g, centre of mass in mm."""
    answer = folder / "weighed.json"
    if run(["identify", str(folder / "second.mcap"), "--json", str(answer), *more]) != 0:
        return float("nan"), float("nan")
    said = json.loads(answer.read_text())
    return 1e3 * abs(said["mass"] - true.mass), 1e3 * float(np.linalg.norm(np.array(said["com"]) - true.com))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--flaws", nargs="+", default=FLAWS)
    arguments = parser.parse_args()
    rows = []
    for name in arguments.flaws:
        for repeat in range(arguments.repeats):
            with tempfile.TemporaryDirectory() as scratch:
                folder = Path(scratch)
                true, saved, answer = (
                    two_recordings(name, repeat, folder),
                    folder / "saved.yaml",
                    folder / "answer.json",
                )
                first = [str(folder / "first.mcap"), "--model", str(folder / "first.yaml")]
                run(["mismatch", *first, "--save", str(saved), "--json", str(answer)])
                named = ", ".join(effect["name"] for effect in json.loads(answer.read_text())["effects"]) or "nothing"
                rows.append((name, named, weighed(folder, true), weighed(folder, true, "--model", str(saved))))
    print("\n| flaw | named | mass off by, g: without / with | centre of mass, mm: without / with |\n| - | - | - | - |")
    for name, named, without, with_it in rows:
        mass, place = (f"{a:.2g} / {b:.2g}" for a, b in zip(without, with_it, strict=True))
        print(f"| {name} | {named} | {mass} | {place} |")


if __name__ == "__main__":
    main()
