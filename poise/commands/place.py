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

from poise.assembly import RigidObject
from poise.assembly.scene import read_object
from poise.commands.output import JsonOption, console, number_for_json, refuse_folder, write_json
from poise.commands.scenes import SceneArgument, findings_json, open_scene
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.placement import (
    CRITERIA,
    DEFAULT_PLANNER,
    PLACEMENT_PLANNERS,
    KeptFree,
    Options,
    Placement,
    PlacementProgress,
    PlacementSequence,
    PoseTest,
    Uncertainty,
    plan_sequence,
)
from poise.worlds import save_scene

_MOST_BYTES = 1_000_000


SpecsOption = Annotated[
    list[str],
    typer.Option(
        "--object",
        metavar="SPEC",
        help="The object to place, as an entry of a scene file without a pose: a YAML or JSON file, or the text. Again "
        "for more objects; the order is found.",
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
PlannerOption = Annotated[str, typer.Option("--planner", help=f"One of {', '.join(PLACEMENT_PLANNERS.names())}.")]
OrdersOption = Annotated[int, typer.Option("--orders", help="Orders of several objects to try.", min=1)]
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
    planner: PlannerOption = DEFAULT_PLANNER,
    orders: OrdersOption = 1,
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
    items = [read_spec(spec, number) for number, spec in enumerate(specs)]
    analysis = open_scene(scene)
    uncertainty = Uncertainty() if robust else None
    looks = looks_of(keep_free)
    options = Options(
        attempts, deadline, candidates, criterion, on, uncertainty=uncertainty, refining=refining, looks=looks
    )
    chosen = PLACEMENT_PLANNERS.find(planner)
    if len(items) > 1 and not chosen.sequences:
        raise InputError(ErrorCode.BAD_INPUT, f"--planner {planner} places one object; give one --object")
    people = console(json_target)
    try:
        with watching(people, attempts) as report:
            if len(items) > 1:
                found: Placement | PlacementSequence = plan_sequence(analysis, items, options, seed, orders, report)
            else:
                found = chosen.plan(analysis, items[0], options, seed, report)
    except NoAnswerError as error:
        write_json(json_target, failure_of(error))
        raise
    content = _sequence_content(found) if isinstance(found, PlacementSequence) else content_of(found)
    write_json(json_target, content | {"findings": findings_json(found.analysis)})
    if output is not None:
        save_scene(found.analysis.assembly, output)
    print_answer(people, found)


def looks_of(keep_free: tuple[float, ...] | None) -> tuple[tuple[str, PoseTest], ...]:
    """For `Options.looks`: the box of the option stays free."""
    if keep_free is None:
        return ()
    return (("in the room to be kept free", KeptFree(np.array(keep_free[:3]), np.array(keep_free[3:]))),)


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
    people.print(f"least robustness of the resulting assembly: {found.score.least:.3g} N")
    counts = sum((Counter(placement.rejected) for placement in placements), Counter[str]())
    rejected = ", ".join(f"{count} {why}" for why, count in counts.most_common())
    tested = sum(placement.iterations for placement in placements)
    people.print(f"{tested} poses tested{f' ({rejected})' if rejected else ''} in {found.seconds:.2f} s")


def failure_of(error: NoAnswerError) -> dict[str, Any]:
    """The reason why there is no answer, as JSON fields."""
    return {"error": error.code.name, "code": int(error.code), "message": error.message, **error.data}


def content_of(found: Placement) -> dict[str, Any]:
    """The answer for programs."""
    return _one(found) | {"robustness": number_for_json(found.score.least), "volume": found.score.volume}


def _sequence_content(found: PlacementSequence) -> dict[str, Any]:
    return {
        "order": list(found.order),
        "placements": [{"id": one.item.id} | _one(one) for one in found.placements],
        "robustness": number_for_json(found.score.least),
        "volume": found.score.volume,
        "iterations": sum(one.iterations for one in found.placements),
        "seconds": found.seconds,
    }


def _one(found: Placement) -> dict[str, Any]:
    return {
        "pose": found.pose.vector,
        "iterations": found.iterations,
        "seconds": found.seconds,
        "rejected": found.rejected,
    }


def read_spec(spec: str, number: int = 0, needs: str | None = None) -> RigidObject:
    """An object entry from a file or from the text itself; nameless ones are numbered; `needs` has to be in it.

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
    return read_object(content, folder, "--object")
