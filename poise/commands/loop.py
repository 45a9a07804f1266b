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

from poise.commands.output import JsonOption, console, refuse_folder, to_json, write_json
from poise.commands.run import prepare_nodes
from poise.errors import ErrorCode, NoAnswerError


def loop(
    robot: Annotated[str, typer.Option("--robot", help="fr3, or another with a file config/loop_ROBOT.yaml.")] = "fr3",
    objects: Annotated[int, typer.Option("--objects", help="Number of unknown objects.", min=1, max=8)] = 5,
    seed: Annotated[int, typer.Option("--seed", help="Equal seeds give equal objects and plans.", min=0)] = 0,
    world: Annotated[
        Path | None,
        typer.Option("--world", help="Scene file of the true world, instead of random objects.", exists=True),
    ] = None,
    distance: Annotated[float, typer.Option("--distance", help="m to carry the stack; 0: not at all.", min=0.0)] = 3.0,
    shapes: Annotated[
        str, typer.Option("--shapes", help="scan: by the camera; given: as in the scene, without a camera.")
    ] = "given",
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for report.html, loop.json, the bag loop.mcap and the nodes' logs."),
    ] = None,
    rerun: Annotated[
        Path | None, typer.Option("--rerun", help="Write the stack as a recording for Rerun (needs the extra viewer).")
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """Run the whole loop on a fake mobile manipulator: scan, pick, weigh, place on the tray, carry.

    The nodes run as separate processes; one that ends is started again. Ctrl-C brings the robot to rest and ends
    them. The exit status is 0 when all objects were weighed, placed and carried, 3 otherwise.

    Example:  poise loop --robot fr3 --objects 5 --seed 1 --out loop
    """
    refuse_folder(json_target, "--json")
    if shapes not in ("scan", "given"):
        raise typer.BadParameter("--shapes is scan or given")
    prepare_nodes("loop")
    people = console(json_target)
    job = import_module("poise.nodes.loop_job")
    with _Screen(people) as screen:
        content = job.run_job(
            job.LoopJob(robot, objects, seed, world, distance, shapes, out, rerun), screen.step, screen.progress
        )
    write_json(json_target, to_json(content))
    _print(people, content)
    if out is not None:
        people.print(f"written: {', '.join(content['files'])}")
    if not content["complete"]:
        code = ErrorCode[content["error"]["name"]] if content["error"] else ErrorCode.NO_PLACEMENT
        raise NoAnswerError(code, content["sentence"] or _not_done(content))


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
    for name in ("object", "outcome", "mass, kg", "true", "off, %", "com off, mm", "within 3 sigma", "stack, N"):
        table.add_column(name, justify="left" if name in ("object", "outcome") else "right")
    for each in content["objects"]:
        cells = ["", "", "", "", ""]
        if "mass" in each:
            cells[0] = f"{each['mass']:.4f} ± {each['mass_std']:.4f}"
        if "true_mass" in each:
            cells[1:] = [
                f"{each['true_mass']:.4f}",
                f"{100 * each['mass_error']:+.2f}",
                f"{1e3 * each['com_error']:.2f}",
                "yes" if each["within"] else "no",
            ]
        strength = each["robustness"]
        cells.append("" if strength is None or math.isnan(strength) else f"{strength:.3g}")
        table.add_row(each["id"], each["outcome"], *cells)
    people.print(table)
    for each in content["objects"]:
        if each["why"]:
            people.print(f"{each['id']}: {each['why']}", markup=False)
    if (carried := content["carried"]) is not None:
        moved = "" if carried["moved"] is None else f"; objects moved by at most {1e3 * carried['moved']:.2f} mm"
        people.print(
            f"carried {carried['distance']:.2f} m in {carried['seconds']:.1f} s, with at most {carried['used']:.0%} of"
            f" the limit of {carried['limit']:.3g} m/s2{moved}"
        )
    people.print(f"{content['seconds']:.0f} s in all, {content['planning']:.1f} s of them planning")


def _not_done(content: dict[str, Any]) -> str:
    done = sum(each["outcome"] == "placed" and "mass" in each for each in content["objects"])
    return f"{done} of {content['wanted']} objects were weighed and placed; the lines above say why"
