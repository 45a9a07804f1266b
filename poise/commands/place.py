"""`poise place`: where to put an object into a scene so that it stays."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import yaml
from rich.console import Console
from rich.progress import Progress as Bar
from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

from poise.assembly import Analysis, RigidObject
from poise.assembly.scene import read_object
from poise.commands.output import JsonOption, console, number_for_json, refuse_folder, write_json
from poise.commands.scenes import SceneArgument, findings_json, open_scene
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import unit
from poise.placement import (
    CRITERIA,
    DEFAULT_PLANNER,
    PLACEMENT_PLANNERS,
    TURNED,
    KeptFree,
    Options,
    PackingOptions,
    Placement,
    PlacementPlanner,
    PlacementProgress,
    PlacementSequence,
    PoseTest,
    Uncertainty,
    Upright,
)
from poise.placement.packing import ORDERS, Packing, encloses
from poise.worlds import save_scene

_MOST_BYTES = 1_000_000
_PACKING = "packing"
_SCORING = {"candidates": "--candidates", "criterion": "--criterion", "refining": "--refine"}
"""Options that compare placements; packing takes the lowest load."""
UpAxes = dict[str, list[str]]
"""Axes that may point up, by the id of an object."""

SpecsOption = Annotated[
    list[str],
    typer.Option(
        "--object",
        metavar="SPEC",
        help="The object to place, as an entry of a scene file without a pose: a YAML or JSON file, or the text. Again "
        "for more objects; the order is found. `up: [z, -z]` in an entry: axes of this object that may point up.",
        show_default=False,
    ),
]
PlacementSeedOption = Annotated[int, typer.Option("--seed", help="Same seed, same answer.", min=0)]
AttemptsOption = Annotated[int, typer.Option("--attempts", help="Poses to test at most.", min=1)]
_DeadlineOption = Annotated[
    float | None,
    typer.Option("--deadline", help="Time limit, s; the best placement by then is returned.", show_default=False),
]
CandidatesOption = Annotated[int, typer.Option("--candidates", help="Placements to find; the best is returned.", min=1)]
CriterionOption = Annotated[str, typer.Option("--criterion", help=f"Criterion of the best: {', '.join(CRITERIA)}.")]
OnOption = Annotated[str, typer.Option("--on", help="What may support it: any, objects or fixed.")]
RobustOption = Annotated[
    bool, typer.Option("--robust", help="Require stability under errors of 2 mm, 2 degrees, 20 % friction, 10 % mass.")
]
RefiningOption = Annotated[bool, typer.Option("--refine", help="Then move it as long as the criterion improves.")]
_PlannerOption = Annotated[
    str | None,
    typer.Option(
        "--planner",
        help=f"One of {', '.join(PLACEMENT_PLANNERS.names())}. Default: {DEFAULT_PLANNER}; packing for several objects "
        "where fixed bodies have walls around a room.",
        show_default=False,
    ),
]
_OrdersOption = Annotated[
    int | None,
    typer.Option(
        "--orders", help=f"Orders of several objects to try: 1, and {ORDERS} to pack.", min=1, show_default=False
    ),
]
UprightOption = Annotated[bool, typer.Option("--upright", help="The z axis of the objects stays up, as --axes z.")]
AxesOption = Annotated[
    str | None,
    typer.Option(
        "--axes",
        metavar="LIST",
        help="Axes of the objects that may point up, from x, y, z, -x, -y, -z, such as z,-z. Default: any.",
        show_default=False,
    ),
]
_IntoOption = Annotated[
    str | None,
    typer.Option(
        "--into",
        metavar="ID",
        help="Pack into, or onto, this fixed body. Default: the largest room that fixed bodies enclose.",
        show_default=False,
    ),
]
_HeightOption = Annotated[
    float | None,
    typer.Option("--height", help="Pack under a lid at this height over the floor inside, m.", show_default=False),
]
_GapOption = Annotated[
    float | None,
    typer.Option(
        "--gap", help=f"Gap between packed objects, and to walls, m. Default: {PackingOptions.gap}.", show_default=False
    ),
]
KeepFreeOption = Annotated[
    tuple[float, float, float, float, float, float] | None,
    typer.Option(
        "--keep-free",
        metavar="X Y Z X Y Z",
        help="Two opposite corners, m, of a box that stays free, for example where objects are picked up.",
        show_default=False,
    ),
]
OutputOption = Annotated[
    Path | None,
    typer.Option("--save", metavar="FILE", help="Write the scene with the object in it.", show_default=False),
]


def place(
    context: typer.Context,
    scene: SceneArgument,
    specs: SpecsOption,
    seed: PlacementSeedOption = 0,
    attempts: AttemptsOption = 500,
    deadline: _DeadlineOption = None,
    candidates: CandidatesOption = 3,
    criterion: CriterionOption = "least",
    on: OnOption = "any",
    robust: RobustOption = False,
    refining: RefiningOption = False,
    planner: _PlannerOption = None,
    orders: _OrdersOption = None,
    upright: UprightOption = False,
    axes: AxesOption = None,
    into: _IntoOption = None,
    height: _HeightOption = None,
    gap: _GapOption = None,
    keep_free: KeepFreeOption = None,
    output: OutputOption = None,
    json_target: JsonOption = None,
) -> None:
    """Find a stable placement for one or more objects in a scene.

    The answer is the pose of the object's frame in the scene, and the least force on the surface of any object that
    moves something afterwards.

    Example:  poise place scene.yaml --object '{id: mug, cylinder: [0.04, 0.1], mass: 0.3}' --json answer.json
    """
    refuse_folder(json_target, "--json")
    up_axes: UpAxes = {}
    items = [read_spec(spec, number, up_axes=up_axes) for number, spec in enumerate(specs)]
    analysis = open_scene(scene, deadline=deadline)
    looks = looks_of(analysis, keep_free, upright, axes, up_axes)
    packing = PackingOptions(into, height, PackingOptions.gap if gap is None else gap)
    uncertainty = Uncertainty() if robust else None
    options = Options(attempts, deadline, candidates, criterion, on, "limit", uncertainty, (), refining, looks, packing)
    chosen = _planner(planner, analysis, items, (into, height, gap) != (None, None, None), _given(context))
    people = console(json_target)
    try:
        with watching(people, attempts) as report:
            found = _plan(chosen, analysis, items, options, seed, orders, report)
    except NoAnswerError as error:
        write_json(json_target, failure_of(error))
        raise
    write_json(json_target, content_of(found) | {"findings": findings_json(found.analysis)})
    if output is not None:
        save_scene(found.analysis.assembly, output)
    print_answer(people, found)


def _plan(
    chosen: PlacementPlanner,
    analysis: Analysis,
    items: list[RigidObject],
    options: Options,
    seed: int,
    orders: int | None,
    report: Callable[[PlacementProgress], bool],
) -> Placement | PlacementSequence:
    if chosen.plan_several is not None and (len(items) > 1 or chosen.name == _PACKING):
        return chosen.plan_several(analysis, items, options, seed, orders, report)
    return chosen.plan(analysis, items[0], options, seed, report)


def _given(context: typer.Context) -> list[str]:
    """The options of `_SCORING` on the command line."""
    sources = {flag: context.get_parameter_source(name) for name, flag in _SCORING.items()}
    return [flag for flag, source in sources.items() if source is not None and source.name == "COMMANDLINE"]


def _planner(
    name: str | None, analysis: Analysis, items: list[RigidObject], packs: bool, scoring: list[str]
) -> PlacementPlanner:
    """The planner that was named, or that suits: several objects are packed where there is a room with walls.

    Args:
        name: None: found.
        analysis: of the scene.
        items: to place.
        packs: an option for packing is given.
        scoring: options that are given of those which compare placements.
    """
    if name is None:
        suits = packs or (len(items) > 1 and not scoring and encloses(analysis.assembly))
        name = _PACKING if suits else DEFAULT_PLANNER
    if name == _PACKING and scoring:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"{', '.join(scoring)}: packing takes the lowest load; leave this out, or place by --planner "
            f"{DEFAULT_PLANNER} without --into, --height and --gap",
        )
    chosen = PLACEMENT_PLANNERS.find(name)
    if packs and name != _PACKING:
        raise InputError(ErrorCode.BAD_INPUT, f"--into, --height and --gap need --planner {_PACKING}, not {name}")
    if len(items) > 1 and chosen.plan_several is None:
        raise InputError(ErrorCode.BAD_INPUT, f"--planner {name} places one object; give one --object")
    return chosen


def looks_of(
    analysis: Analysis, keep_free: tuple[float, ...] | None, upright: bool, axes: str | None, of: UpAxes
) -> tuple[tuple[str, PoseTest], ...]:
    """For `Options.looks`: the box of an option stays free, and allowed axes of the objects point up.

    Raises:
        InputError: BAD_INPUT for an unknown axis, or when --upright and --axes are given.
    """
    looks: list[tuple[str, PoseTest]] = []
    if keep_free is not None:
        room = KeptFree(np.array(keep_free[:3]), np.array(keep_free[3:]))
        looks.append(("in the room to be kept free", room))
    if upright and axes is not None:
        raise InputError(ErrorCode.BAD_INPUT, "--upright and --axes: give one of them")
    allowed = ["z"] if upright else [] if axes is None else [axis.strip() for axis in axes.split(",")]
    if allowed or of:
        looks.append((TURNED, Upright(allowed, of, -unit(np.asarray(analysis.assembly.gravity)))))
    return tuple(looks)


@contextmanager
def watching(people: Console, attempts: int) -> Iterator[Callable[[PlacementProgress], bool]]:
    """A progress line on the terminal."""
    with Bar(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=people) as bar:
        task = bar.add_task("looking", total=None)

        def report(progress: PlacementProgress) -> bool:
            found = "" if progress.best is None else ", one that stays is found"
            bar.update(task, description=f"pose {progress.iteration} of up to {attempts}{found}")
            return True

        yield report


def print_answer(people: Console, found: Placement | PlacementSequence) -> None:
    """Print the answer as text."""
    placements = found.placements if isinstance(found, PlacementSequence) else (found,)
    for number, placement in enumerate(placements):
        x, y, z, *quaternion = placement.pose.vector
        turn = f"{number + 1}. " if len(placements) > 1 else ""
        where = f"x {x:.4f} y {y:.4f} z {z:.4f} m, quaternion {np.round(quaternion, 4).tolist()}"
        people.print(f"{turn}{placement.item.id}: stable at {where}")
    least = _robustness(found)
    certified = "no solver certifies it" if least is None else f"{least:.3g} N"
    people.print(f"least robustness of the resulting assembly: {certified}")
    if isinstance(found, Packing):
        filled = "" if found.filled is None else f", {found.filled:.0%} of the container"
        people.print(
            f"load in {', '.join(found.container.names)}: top {found.top:.4g} m over the floor, utilisation "
            f"{found.utilisation:.0%} up to there{filled}; weakest margin {found.margin:.3g} N"
        )
    counts = sum((Counter(placement.rejected) for placement in placements), Counter[str]())
    rejected = ", ".join(f"{count} {why}" for why, count in counts.most_common())
    tested = sum(placement.iterations for placement in placements)
    people.print(f"{tested} poses tested{f' ({rejected})' if rejected else ''} in {found.seconds:.2f} s")


def failure_of(error: NoAnswerError) -> dict[str, Any]:
    """The reason why there is no answer, as JSON fields."""
    return {"error": error.code.name, "code": int(error.code), "message": error.message, **error.data}


def content_of(found: Placement | PlacementSequence) -> dict[str, Any]:
    """The answer for programs."""
    return _sequence_content(found) if isinstance(found, PlacementSequence) else _one(found) | _score(found)


def _sequence_content(found: PlacementSequence) -> dict[str, Any]:
    return {
        "order": list(found.order),
        "placements": [{"id": one.item.id} | _one(one) for one in found.placements],
        **_score(found),
        "iterations": sum(one.iterations for one in found.placements),
        "seconds": found.seconds,
        **(_packing_content(found) if isinstance(found, Packing) else {}),
    }


def _packing_content(found: Packing) -> dict[str, Any]:
    container = found.container
    top = container.top
    return {
        "top": found.top,
        "utilisation": found.utilisation,
        "filled": found.filled,
        "margin": found.margin,
        "container": {
            "objects": list(container.names),
            "size": (container.high - container.low).tolist(),
            "depth": None if top is None else top - container.floor,
            "volume": None if top is None else container.volume(top),
        },
    }


def _score(found: Placement | PlacementSequence) -> dict[str, Any]:
    """The certified robustness, and the volume; None where a solver fails: the placements were certified before."""
    try:
        return {"robustness": number_for_json(found.score.least), "volume": found.score.volume}
    except NoAnswerError:
        return {"robustness": None, "volume": None}


def _robustness(found: Placement | PlacementSequence) -> float | None:
    try:
        return found.score.least
    except NoAnswerError:
        return None


def _one(found: Placement) -> dict[str, Any]:
    return {
        "pose": found.pose.vector,
        "iterations": found.iterations,
        "seconds": found.seconds,
        "rejected": found.rejected,
    }


def read_spec(spec: str, number: int = 0, needs: str | None = None, up_axes: UpAxes | None = None) -> RigidObject:
    """An object entry from a file or from the text itself; nameless ones are numbered; `needs` has to be in it.

    Its `up`, the axes that may point up, goes to `up_axes`.

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, or what is wrong with the entry.
    """
    text, folder = spec, Path()
    path = Path(spec)
    if "{" not in spec and ":" not in spec:
        folder = path.parent
        try:
            if path.stat().st_size > _MOST_BYTES:
                raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: too large for one object entry")
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise InputError(ErrorCode.FILE_UNREADABLE, f"--object {path}: {error.strerror or error}") from error
    try:
        content = yaml.safe_load(text)
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"--object: not YAML: {' '.join(str(error).split())}") from error
    if isinstance(content, dict):
        content.setdefault("id", f"placed_{number + 1}" if number else "placed")
        if needs is not None and needs not in content:
            raise InputError(ErrorCode.BAD_INPUT, f"--object: {needs} is missing; give it")
        if up_axes is not None and "up" in content:
            up = content.pop("up")
            axes = [up] if isinstance(up, str) else up
            if not isinstance(axes, list) or not all(isinstance(axis, str) for axis in axes):
                raise InputError(ErrorCode.BAD_INPUT, f"--object: up is {up!r}; give a list such as [z, -z]")
            up_axes[str(content["id"])] = axes
    return read_object(content, folder, "--object")
