"""Tables 3.3, 3.4 and 3.8 of the thesis, rebuilt for every estimator side by side, with the bounds beside them.

python -m benchmarks.identification.run [--quick] [--final] [--seeds N] [--only KEY] [--tools PATH] [--out FOLDER]
"""

import argparse
import functools
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from benchmarks.identification.bounds import BOUNDS
from benchmarks.identification.evaluation import Experiment, Record, Summary, run, summarise
from benchmarks.identification.figure import draw
from benchmarks.identification.modular import modular_objects
from benchmarks.identification.objects import load_tools
from benchmarks.identification.scenarios import DEVELOPMENT_SEEDS, FINAL_SEEDS, Scenario
from poise.inertia.estimators.pmd import pmd
from poise.inertia.estimators.registry import method, method_names

SPEEDS = (1.0, 1.5, 2.0)  # rad/s
ERRORS = ("e_m %", "e_c %", "e_I %", "e_Rie", "cons. %", "effort %", "delay ms")
HEADINGS = ("", *ERRORS, "ms", "NEES/10", "95 %", "answers %")
console = Console(width=None if sys.stdout.isatty() else 130)  # a file has room for all columns


def experiments(tools: Path | None) -> list[Experiment]:
    """What is compared: the thesis' tables, and the same motions with tools, bias and delay."""
    methods = {name: method(name) for name in method_names()}
    moving = {name: call for name, call in methods.items() if name != "hps"}  # which has to stand still
    robot = {"pmd-5k": functools.partial(pmd, c1=5e3), "pmd-25k": functools.partial(pmd, c1=25e3)}
    on_robot = {name: call for name, call in moving.items() if name != "pmd"} | robot
    fast = tuple(Scenario(f"{speed} rad/s", speed) for speed in SPEEDS)
    flaws = (
        Scenario("1.5 rad/s, bias", 1.5, bias=True),
        Scenario("1.5 rad/s, 20 ms late", 1.5, delay=0.02),
        Scenario("1.5 rad/s, 50 ms late", 1.5, delay=0.05),
    )
    still = (
        *(Scenario(f"stop-and-go, {noise} noise", noise=noise) for noise in ("no", "low", "moderate", "high")),
        Scenario("stop-and-go, bias", bias=True),
        Scenario("stop-and-go, 20 ms late", delay=0.02),
        Scenario("stop-and-go, 50 ms late", delay=0.05),
    )
    # What sets a real robot apart from table 3.3: a sensor that has drifted, and clocks that are not one.
    as_on_robot = (Scenario("1.1 rad/s, bias, 20 ms late", 1.1, bias=True, delay=0.02),)
    plates, hand_tools = modular_objects(), load_tools(tools)
    return [
        Experiment("table_3_3", "Table 3.3: modular test object, 1.5 s of motion", plates, fast, moving),
        Experiment("tools", "Workshop tools, 1.5 s of motion as in table 3.3", hand_tools, fast + flaws, moving),
        Experiment("table_3_4", "Table 3.4, simulated: modular test object, 1.5 s", plates, as_on_robot, on_robot),
        Experiment("table_3_8", "Table 3.8: workshop tools, 10 s of stop-and-go", hand_tools, still, methods),
    ]


def run_all(chosen: Sequence[Experiment], seeds: Sequence[int]) -> dict[str, list[Record]]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    records: dict[str, list[Record]] = {}
    with Progress(*columns, console=console, transient=True) as progress:
        for experiment in chosen:
            trials = len(seeds) * len(experiment.scenarios) * len(experiment.subjects)
            task = progress.add_task(experiment.key, total=trials)
            records[experiment.key] = list(run(experiment, seeds, functools.partial(progress.advance, task)))
    return records


def table(experiment: Experiment, summaries: dict[tuple[str, str], Summary]) -> Table:
    made = Table(title=experiment.title, title_justify="left")
    for heading in HEADINGS:
        made.add_column(heading, justify="left" if not heading else "right")
    for scenario in experiment.scenarios:
        made.add_section()
        made.add_row(f"[bold]{scenario.name}")
        for (name, who), figures in summaries.items():
            if name == scenario.name:
                made.add_row(f"  {who}", *_cells(figures), style="dim" if who in BOUNDS else "")
    return made


def _cells(figures: Summary) -> list[str]:
    values = (figures.mass, figures.com, figures.inertia, figures.riemannian)
    others = (figures.effort, 1e3 * figures.delay_error, figures.milliseconds, figures.nees / 10, figures.covered)
    is_bound = math.isnan(figures.milliseconds)
    return [
        *(_number(value) for value in values),
        "" if is_bound else f"{figures.consistent:.0f}",
        *(_number(value) for value in others),
        "" if is_bound and figures.answered == 100 else f"{figures.answered:.0f}",
    ]


def _number(value: float) -> str:
    if math.isnan(value):
        return ""
    return ">500" if value > 500 else f"{value:.{2 if value < 10 else 1}f}"


def write(
    folder: Path, experiment: Experiment, records: list[Record], summaries: dict[tuple[str, str], Summary]
) -> None:
    """The JSON file of a table (averages, and every trial) and its picture."""
    averages = [
        {"scenario": scenario, "method": who}
        | {key: value for key, value in asdict(figures).items() if key != "details"}
        for (scenario, who), figures in summaries.items()
    ]
    content = {"title": experiment.title, "averages": averages, "trials": [asdict(one) for one in records]}
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"identification_{experiment.key}.json"
    unfinished = target.with_suffix(".partial")
    unfinished.write_text(json.dumps(_without_nan(content), indent=1, allow_nan=False))
    unfinished.replace(target)
    draw(folder / f"identification_{experiment.key}.png", experiment, summaries)


def _without_nan(value: object) -> object:
    """The same with null for NaN and infinity, which JSON does not have."""
    if isinstance(value, dict):
        return {key: _without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_without_nan(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one seed instead of eight")
    parser.add_argument("--seeds", type=int, default=8, help="how many of the eight; all of them take half an hour")
    parser.add_argument("--only", action="append", help="one of the tables: table_3_3, tools, table_3_4, table_3_8")
    parser.add_argument("--final", action="store_true", help="seeds that nothing was tuned on")
    parser.add_argument("--tools", type=Path, help="other tools: the dataset's folder, or an .npz made of it")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    seeds = FINAL_SEEDS if arguments.final else DEVELOPMENT_SEEDS
    seeds = seeds[:1] if arguments.quick else seeds[: arguments.seeds]
    chosen = [one for one in experiments(arguments.tools) if not arguments.only or one.key in arguments.only]
    records = run_all(chosen, seeds)
    for experiment in chosen:
        summaries = summarise(records[experiment.key])
        console.print(table(experiment, summaries), "")
        write(arguments.out, experiment, records[experiment.key], summaries)
    kind = "final" if arguments.final else "development"
    console.print(f"Means over objects and {len(seeds)} {kind} seeds; time (ms) is the median, on one core.")
    console.print("effort: error of predicted torques on another motion; delay: error of the estimated clock delay;")
    console.print("95 %: share of parameters inside their 95 % intervals; answers: of all trials.")
    for name, meaning in BOUNDS.items():
        console.print(f"{name}: {meaning}")
    console.print(f"Details and pictures: {arguments.out}/identification_*")


if __name__ == "__main__":
    main()
