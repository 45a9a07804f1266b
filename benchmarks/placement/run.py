"""Table 5.1 of the thesis, all planners in one run: `python -m benchmarks.placement.run [--quick]`.

Every planner places the same cube in the nine scenes, with at most 500 attempts; what it returns is judged by the
same analysis and by two seconds of MuJoCo. Seconds are of the processor. `--develop` runs stretched scenes and other
cuboids instead, which is what the planner was tuned on. Results go to out/benchmarks/placement.json.
"""

import argparse
import json
import math
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from benchmarks.placement.scenes import SCENES, box, cube, scene
from benchmarks.placement.trial import NAN, STILL, Trial, mean, run
from poise.files import write_whole
from poise.placement import DEFAULT_PLANNER, PLACEMENT_PLANNERS, Options

EVERYONE = (*sorted(PLACEMENT_PLANNERS.names(), key=lambda name: name != DEFAULT_PLANNER), "robust")
SHORT = {"uniform": 20, "robust": 20, "sim-above": 10, "hm": 4, "sim-random": 2, "chance": 1}
"""Runs a scene, at the most, of what takes seconds a placement, unless --whole."""
ATTEMPTS = 500
SAVED_EVERY = 20
FINAL, DEVELOPMENT = 10_000, 0
"""First seeds."""
console = Console(width=150)


def one(job: tuple[str, str, int, bool, int]) -> Trial:
    name, planner, seed, develop, attempts = job
    assembly, item = scene(name), cube()
    if develop:
        rng = np.random.default_rng([seed, 1])
        assembly = scene(name, tuple(rng.uniform(0.9, 1.12, 3).tolist()))
        item = box("placed", tuple(rng.uniform(0.08, 0.12, 3).tolist()), (0, 0, 0))
    return run(name, assembly, item, planner, seed, Options(attempts=attempts, on="objects"))


def run_all(jobs: list[tuple[str, str, int, bool, int]], workers: int, out: Path) -> list[Trial]:
    """Trials in the order of the jobs, in processes of their own; what is known so far is in the file all along."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    trials: dict[int, Trial] = {}
    with Progress(*columns, console=console) as progress, ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        task = progress.add_task("placements", total=len(jobs))
        futures = {pool.submit(one, job): number for number, job in enumerate(jobs)}
        for future in as_completed(futures):
            trials[futures[future]] = future.result()
            progress.advance(task)
            if len(trials) % SAVED_EVERY == 0:
                save(list(trials.values()), out)
    return [trials[number] for number in range(len(jobs))]


ROWS = (
    ("time ms", lambda t: 1e3 * t.seconds, 0),
    ("wrench N", lambda t: t.wrench, 2),
    ("least N", lambda t: t.least, 2),
    ("volume l", lambda t: 1e3 * t.volume, 1),
)


def table(trials: Iterable[Trial], planners: list[str]) -> Table:
    """Table 5.1: means over the runs with a placement; the time is the mean per placement, failures included."""
    trials = list(trials)
    found = Table(title="Means per placement (Table 5.1 of the thesis)")
    for name in ("scene", "", *planners):
        found.add_column(name, justify="right")
    for name in [name for name in SCENES if any(t.scene == name for t in trials)]:
        for label, of, digits in ROWS:
            cells = [
                _cell([t for t in trials if (t.scene, t.planner) == (name, p)], label, of, digits) for p in planners
            ]
            found.add_row(name if label == ROWS[0][0] else "", label, *cells)
        found.add_section()
    for label, of in TOTALS.items():
        found.add_row("all", label, *(of([t for t in trials if t.planner == p]) for p in planners))
    return found


def _cell(trials: list[Trial], label: str, of: "object", digits: int) -> str:
    placed = [t for t in trials if t.success]
    if not placed:
        return "—"
    value = sum(map(of, trials)) / len(placed) if label.startswith("time") else mean([of(t) for t in placed])
    return f"{value:.{digits}f}"


def per_placement(trials: list[Trial]) -> float:
    """s, failures included; infinite when there is none."""
    placed = sum(t.success for t in trials)
    return sum(t.seconds for t in trials) / placed if placed else math.inf


def _time(trials: list[Trial]) -> str:
    return f"{1e3 * per_placement(trials):.0f}"


def _longest(trials: list[Trial]) -> str:
    return f"{1e3 * max(t.seconds for t in trials):.0f}"


def _least(trials: list[Trial]) -> str:
    return f"{mean([t.least for t in trials]):.2f}"


def _success(trials: list[Trial]) -> str:
    return f"{sum(t.success for t in trials)} of {len(trials)}"


def _holds(trials: list[Trial]) -> str:
    placed = [t for t in trials if t.success]
    return f"{sum(t.moved < STILL for t in placed)} of {len(placed)}"


def _shaken(trials: list[Trial]) -> str:
    asked = [t for t in trials if not math.isnan(t.shaken)]
    return f"{sum(t.shaken < STILL for t in asked)} of {len(asked)}" if asked else ""


TOTALS = {
    "time ms": _time,
    "longest ms": _longest,
    "least N": _least,
    "success": _success,
    "holds in MuJoCo": _holds,
    "with errors": _shaken,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two runs a scene, 30 attempts, no chance and sim-random")
    parser.add_argument("--runs", type=int, default=50, help="of each planner in each scene")
    parser.add_argument("--whole", action="store_true", help=f"as many of the slow planners too (else {SHORT})")
    parser.add_argument("--develop", action="store_true", help="stretched scenes and another cuboid")
    parser.add_argument("--planner", action="append", help=f"one of {', '.join(EVERYONE)}; again for more")
    parser.add_argument("--scene", action="append", help=f"one of {', '.join(SCENES)}; again for more")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks/placement.json"))
    parser.add_argument("--show", action="store_true", help="only print the table of the results there are")
    arguments = parser.parse_args()
    if arguments.show:
        show(load(arguments.out))
        return
    planners = arguments.planner or [p for p in EVERYONE if not (arguments.quick and p in ("chance", "sim-random"))]
    runs, attempts = (2, 30) if arguments.quick else (arguments.runs, ATTEMPTS)
    first = DEVELOPMENT if arguments.develop else FINAL
    jobs = [
        (name, planner, first + k, arguments.develop, attempts)
        for k in range(runs)  # the outermost, so that a run that is cut short has as many of each scene
        for planner in planners
        for name in arguments.scene or SCENES
        if arguments.whole or k < SHORT.get(planner, runs)
    ]
    trials = run_all(jobs, arguments.workers, arguments.out)
    save(trials, arguments.out)
    show(trials)


def show(trials: list[Trial]) -> None:
    console.print(table(trials, [p for p in EVERYONE if any(t.planner == p for t in trials)]))


def load(out: Path) -> list[Trial]:
    """The results in a file, some of which may never have been."""
    rows = json.loads(out.read_text())
    return [Trial(**{key: NAN if value is None else value for key, value in row.items()}) for row in rows]


def save(trials: list[Trial], out: Path) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    content = [{key: _plain(value) for key, value in asdict(trial).items()} for trial in trials]
    write_whole(out, json.dumps(content, indent=0).encode())


def _plain(value: object) -> object:
    """JSON has no NaN and no infinity."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


if __name__ == "__main__":
    main()
