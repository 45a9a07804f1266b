"""`poise loop`: a fake mobile manipulator scans, picks, weighs, places and carries unknown objects."""

import math
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from poise.assembly import Analysis, Assembly
from poise.commands.output import JsonOption, add_scene, console, refuse_folder, write_json
from poise.commands.run import prepare_nodes
from poise.errors import ErrorCode, NoAnswerError
from poise.viewing import (
    LOOP_COLUMNS,
    loop_rows,
    loop_sentences,
    write_assembly_recording,
    write_loop_report,
)

RealTimeOption = Annotated[
    bool, typer.Option("--real-time", help="Run in the time of the machine, which then has to keep up.")
]
RateOption = Annotated[
    float,
    typer.Option("--rate", help="s of simulated time in a second, where the machine keeps up.", min=0.05, max=20.0),
]


def loop(
    robot: Annotated[str, typer.Option("--robot", help="fr3, or another with a file config/loop_ROBOT.yaml.")] = "fr3",
    objects: Annotated[int, typer.Option("--objects", help="Number of unknown objects.", min=1, max=8)] = 5,
    seed: Annotated[int, typer.Option("--seed", help="Equal seeds give equal objects and plans.", min=0)] = 0,
    world: Annotated[
        Path | None,
        typer.Option("--world", help="Scene file of the true world, instead of random objects."),
    ] = None,
    distance: Annotated[float, typer.Option("--distance", help="m to carry the stack; 0: not at all.", min=0.0)] = 3.0,
    shapes: Annotated[
        str, typer.Option("--shapes", help="scan: by the camera; given: as in the scene, without a camera.")
    ] = "scan",
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for report.html, loop.json, the bag loop.mcap and the nodes' logs."),
    ] = None,
    real_time: RealTimeOption = False,
    rate: RateOption = 1.0,
    rerun: Annotated[
        Path | None, typer.Option("--rerun", help="Write the stack as a recording for Rerun (needs the extra viewer).")
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """Run the whole loop on a fake robot: scan, pick, weigh, place and carry unknown objects.

    The nodes run as separate processes; one that ends is started again. Ctrl-C brings the robot to rest and ends
    them. The exit status is 0 when all objects were weighed, placed and carried, 3 otherwise.

    Example:  poise loop --robot fr3 --objects 5 --seed 1 --out loop
    """
    refuse_folder(json_target, "--json")
    if shapes not in ("scan", "given"):
        raise typer.BadParameter("--shapes is scan or given")
    prepare_nodes("loop")
    people = console(json_target)
    job = import_module("poise.fake_robots.loop_job")
    with _Screen(people) as screen:
        asked = job.LoopJob(robot, objects, seed, world, distance, shapes, out, real_time, rate)
        content, stack = job.run_job(asked, screen.step, screen.progress)
    written = _files(content, stack, out, rerun)
    write_json(json_target, content)
    _print(people, content)
    if written:
        people.print(f"written: {', '.join(map(str, written))}")
    if not content["complete"]:
        code = ErrorCode[content["error"]["name"]] if content["error"] else ErrorCode.NO_PLACEMENT
        raise NoAnswerError(code, content["sentence"] or _not_done(content))


def _files(content: dict[str, Any], stack: Assembly | None, out: Path | None, rerun: Path | None) -> list[Path]:
    """Write what was asked for, besides the bag; the names of all files."""
    analysis, written = None if stack is None else Analysis.of(stack), []
    if out is not None:
        write_json(str(out / "loop.json"), content)
        written = [write_loop_report(out, content, analysis), out / "loop.json", out / "loop.mcap"]
    if rerun is not None and analysis is not None:
        return add_scene(written, lambda: write_assembly_recording(rerun, analysis))
    return written


class _Screen:
    """One line for each step that has ended, and a bar for the one that runs.

    Args:
        people: console to print on.
    """

    def __init__(self, people: Console) -> None:
        self._people = people
        columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
        self._bar = Progress(*columns, console=people, transient=True, disable=not people.is_terminal)
        self._task = self._bar.add_task("starting the nodes", total=None)
        self._stack = ExitStack()
        self._words = ""

    def __enter__(self) -> "_Screen":
        self._stack.enter_context(self._bar)
        return self

    def __exit__(self, *reason: object) -> None:
        self._stack.close()

    def step(self, record: Any, words: str) -> None:
        """A step begins, or has ended."""
        if record is None:
            self._words = words
            self._bar.reset(self._task, description=words, total=None)
            return
        what = f"{record.step:6} {record.name:10} {record.seconds:6.1f} s"
        if record.code is not ErrorCode.OK:
            what += f"  {record.code.name}: {record.message}"
        self._people.print(what, markup=False)

    def progress(self, words: str, share: float) -> None:
        """The node of the step says how far it is."""
        known = math.isfinite(share)
        self._bar.update(
            self._task,
            description=f"{self._words}: {words}" if words else self._words,
            total=1.0 if known else None,
            completed=share if known else 0.0,
        )


def _print(people: Console, content: dict[str, Any]) -> None:
    table = Table(title="Objects", title_justify="left")
    for name in LOOP_COLUMNS:
        table.add_column(name, justify="left" if name in LOOP_COLUMNS[:2] else "right")
    for row in loop_rows(content):
        table.add_row(*row)
    people.print(table)
    for sentence in loop_sentences(content):
        people.print(sentence, markup=False)


def _not_done(content: dict[str, Any]) -> str:
    done = sum(each["outcome"] == "placed" and "mass" in each for each in content["objects"])
    return f"{done} of {content['wanted']} objects were weighed and placed; the lines above say why"
