"""Whole loops of random objects in the fake robot: `python -m benchmarks.loop [--seeds 5] [--first 100] [--kill NODE]`.

Each seed is one run of `poise loop`, with its nodes as processes, in simulated time. With --out FOLDER each result is
kept there, by commit and seed; a series that was stopped goes on where it was, and the table is over all in the folder.
A seed that another commit has answered is not asked again. With `--kill any` one node is killed by
SIGKILL at a random time of each loop. The stack of each loop is then carried in MuJoCo at 0.8, 1.0 and 1.5 times its
limits.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.touching import holds_in_mujoco
from poise.assembly import Analysis, Assembly, acceleration_limits
from poise.errors import PoiseError
from poise.files import write_whole
from poise.world import load_world

SHARES = (0.8, 1.0, 1.5)
"""Of the limits at which the stack is carried in MuJoCo; `object_carrier` uses 0.8 at most."""
STEPS = {"scan": None, "pick": 0.82, "weigh": None, "place": 0.892, "carry": None}
"""Steps of a loop, and what the thesis reached (Table 5.2)."""
KILLED = ("world_model", "object_scanner", "object_picker", "placement_planner", "inertial_estimator")
KILLED += ("acceleration_limits", "object_carrier", "robustness_server")
DIRECTIONS = 6
PATIENCE = 1800.0
"""s that one loop may take on a machine that does other things."""
console = Console(width=120)


def one_loop(
    seed: int, objects: int, distance: float, shapes: str, kill: str, out: Path, time_given: Sequence[str] = ()
) -> dict[str, Any]:
    """The content of loop.json of one run, with what came of its stack in MuJoCo."""
    command = [sys.executable, "-m", "poise.cli", "loop", "--seed", str(seed), "--objects", str(objects)]
    command += ["--distance", str(distance), "--shapes", shapes, "--out", str(out)]
    command += time_given
    rng = np.random.default_rng([seed, 9])
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    killed: list[str] = []
    if kill:
        victim = str(rng.choice(KILLED)) if kill == "any" else kill
        threading.Thread(target=_kill, args=(victim, process, killed, rng.uniform(60, 240)), daemon=True).start()
    try:
        said = process.communicate(timeout=PATIENCE)[1]
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
        said = process.communicate()[1]
    file = out / "loop.json"
    content: dict[str, Any] = json.loads(file.read_text()) if file.exists() else {"complete": False, "objects": []}
    content |= {
        "status": process.returncode,
        "said": said.strip().splitlines()[-1:],
        "seed": seed,
        "killed": "".join(killed),
    }
    if content.get("carried"):
        content["mujoco"] = carried_in_mujoco(load_world(out / "world_state").assembly)
    return content


def _kill(name: str, parent: subprocess.Popen[str], killed: list[str], after: float) -> None:
    """Kill a node of a loop, by its process id, and note its name; a loop that is over has none."""
    time.sleep(after)
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().decode().split("\0")
                ours = int((entry / "stat").read_text().rpartition(")")[2].split()[1]) == parent.pid
            except (OSError, ValueError):
                continue
            if ours and any(word.endswith(f"/{name}") for word in words):
                os.kill(int(entry.name), signal.SIGKILL)
                killed.append(name)
                return


def carried_in_mujoco(stack: Assembly | None) -> dict[str, list[bool]]:
    """Whether the stack holds at shares of its limits, in some directions."""
    if stack is None:
        return {}
    angles = np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False)
    directions = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    try:
        limits = acceleration_limits(Analysis.of(stack), directions, 60.0, turning=False).limits
        return {
            str(share): [
                holds_in_mujoco(stack, share * limit * way) for limit, way in zip(limits, directions, strict=True)
            ]
            for share in SHARES
        }
    except PoiseError as error:
        console.print(f"MuJoCo: {error.message}", markup=False)
        return {}


class _Kept:
    """Results in a folder: COMMIT/SEED.json, and SEED-killed.json where a node was to be killed."""

    def __init__(self, folder: Path, objects: int, kill: str) -> None:
        answer = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
        self._folder, self._commit = folder, answer.stdout.strip() or "unknown"
        self._end = f"{'' if objects == 5 else f'-{objects}'}{'-killed' if kill else ''}.json"

    def has(self, seed: int) -> bool:
        """Whether any commit has answered a seed."""
        return any(self._folder.glob(f"*/{seed}{self._end}"))

    def keep(self, loop: dict[str, Any], out: Path) -> None:
        """Write the result of a seed; of one that is not complete the logs of its nodes, too."""
        file = self._folder / self._commit / f"{loop['seed']}{self._end}"
        file.parent.mkdir(parents=True, exist_ok=True)
        if not loop["complete"]:
            shutil.copytree(out, file.with_suffix(".logs"), ignore=shutil.ignore_patterns("*.mcap"), dirs_exist_ok=True)
        write_whole(file, json.dumps(loop | {"commit": self._commit, "load": os.getloadavg()[1]}, indent=1).encode())

    def all(self) -> list[dict[str, Any]]:
        """What the folder has, of all commits."""
        found = sorted(self._folder.glob("*/*.json"), key=lambda file: (int(file.stem.split("-")[0]), file.stem))
        return [json.loads(file.read_text()) for file in found]


def summary(loops: list[dict[str, Any]]) -> dict[str, Any]:
    """The counts of the table."""
    objects = [each for loop in loops for each in loop["objects"] if "true_mass" in each]
    asked = sum(loop.get("wanted", 0) for loop in loops)
    done: Counter[str] = Counter()
    tried: Counter[str] = Counter()
    for loop in loops:
        for step in STEPS:
            names = {each["object"] for each in loop.get("steps", []) if each["step"] == step}
            good = {each["object"] for each in loop.get("steps", []) if each["step"] == step and each["code"] == 0}
            tried[step] += len(names)
            done[step] += len(good)
    moved = [loop["carried"]["moved"] for loop in loops if loop.get("carried")]
    held = {share: [ok for loop in loops for ok in loop.get("mujoco", {}).get(share, [])] for share in map(str, SHARES)}
    return {
        "loops": len(loops),
        "complete": sum(loop["complete"] for loop in loops),
        "coded": sum(not loop["complete"] and loop["status"] == 3 for loop in loops),
        "objects": asked,
        "placed": sum(each["outcome"] == "placed" for loop in loops for each in loop["objects"]),
        "weighed": len(objects),
        "mass_error": float(np.median([abs(each["mass_error"]) for each in objects])) if objects else None,
        "com_error": float(np.median([each["com_error"] for each in objects])) if objects else None,
        "within": sum(each["within"] for each in objects),
        "steps": {step: [done[step], tried[step]] for step in STEPS},
        "carried_moved": max(moved, default=None),
        "planning": [loop.get("planning") for loop in loops],
        "seconds": [loop.get("seconds") for loop in loops],
        "machine_seconds": [loop.get("machine_seconds") for loop in loops],
        "killed": [
            [loop["complete"] for loop in loops if loop.get("killed")].count(True),
            sum(bool(loop.get("killed")) for loop in loops),
        ],
        "mujoco": {share: [sum(oks), len(oks)] for share, oks in held.items()},
    }


def show(found: dict[str, Any]) -> None:
    """The table of the issue."""
    table = Table(title=f"{found['loops']} loops")
    table.add_column("")
    table.add_column("measured", justify="right")
    table.add_row("complete", f"{found['complete']} of {found['loops']}")
    table.add_row("not complete, ended with a code", str(found["coded"]))
    table.add_row("complete, of those with a node killed", "{} of {}".format(*found["killed"]))
    table.add_row("objects placed; weighed", f"{found['placed']}; {found['weighed']} of {found['objects']}")
    if found["weighed"]:
        table.add_row("mass, median error", f"{100 * found['mass_error']:.2f} %")
        table.add_row("centre of mass, median error", f"{1e3 * found['com_error']:.2f} mm")
        table.add_row("all within 3 sigma", f"{found['within']} of {found['weighed']}")
    for step, (done, tried) in found["steps"].items():
        thesis = f" (thesis {STEPS[step]:.0%})" if STEPS[step] else ""
        table.add_row(f"{step}{thesis}", f"{done} of {tried}")
    if found["carried_moved"] is not None:
        table.add_row("largest motion on the tray", f"{1e3 * found['carried_moved']:.2f} mm")
    for share, (held, asked) in found["mujoco"].items():
        table.add_row(f"holds in MuJoCo at {share} x the limit", f"{held} of {asked}")
    table.add_row(
        "planning and computing, s", ", ".join(f"{each:.0f}" for each in found["planning"] if each is not None)
    )
    for name, key in (("whole loop, s of its time", "seconds"), ("whole loop, s of the machine", "machine_seconds")):
        table.add_row(name, ", ".join(f"{each:.0f}" for each in found[key] if each is not None))
    console.print(table)


def main() -> None:
    """Run the loops and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=100, help="first seed")
    parser.add_argument("--objects", type=int, default=5)
    parser.add_argument("--distance", type=float, default=3.0)
    parser.add_argument("--shapes", default="scan", choices=("scan", "given"))
    parser.add_argument(
        "--kill", default="", metavar="NODE", help="kill this node once in each loop; any: a random one"
    )
    parser.add_argument("--quick", action="store_true", help="one loop of one object")
    parser.add_argument(
        "--real-time", action="store_true", help="in the time of the machine, as poise loop --real-time"
    )
    parser.add_argument("--rate", type=float, default=1.0, help="s of simulated time in a second, at most")
    parser.add_argument("--out", type=Path, help="keep the result of each seed in this folder, and go on with it")
    parser.add_argument("--json", type=Path, help="write all results there")
    options = parser.parse_args()
    time_given = ["--real-time"] if options.real_time else ["--rate", str(options.rate)]
    seeds, objects = (1, 1) if options.quick else (options.seeds, options.objects)
    loops = []
    kept = options.out and _Kept(options.out, objects, options.kill)
    for seed in range(options.first, options.first + seeds):
        if kept and kept.has(seed):
            continue
        with TemporaryDirectory() as folder:
            loop = one_loop(seed, objects, options.distance, options.shapes, options.kill, Path(folder), time_given)
            if kept:
                kept.keep(loop, Path(folder))
        loops.append(loop)
        state = "complete" if loop["complete"] else f"not complete: {' '.join(loop['said'])}"
        console.print(f"seed {seed}: {state}{', killed ' + loop['killed'] if loop['killed'] else ''}", markup=False)
    loops = kept.all() if kept else loops
    found = summary(loops)
    show(found)
    if options.json:
        write_whole(options.json, json.dumps({"summary": found, "loops": loops}, indent=1).encode())


if __name__ == "__main__":
    main()
