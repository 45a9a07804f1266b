"""`poise place`: where to put an object into a scene so that it stays."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import yaml
from rich.progress import Progress as Bar
from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

from poise.assembly import RigidObject, read_object, write_scene
from poise.commands.output import console, refuse_folder, write_json
from poise.commands.scenes import open_scene
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.placement import CRITERIA, Options, Placement, Progress, Uncertainty, plan_placement

MOST_BYTES = 1_000_000


SceneArgument = Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file (YAML).", show_default=False)]
SpecOption = Annotated[
    str,
    typer.Option(
        "--object",
        metavar="SPEC",
        help="The object to place, as an entry of a scene file without a pose: a YAML or JSON file, or the text.",
        show_default=False,
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", help="Same seed, same answer.", min=0)]
AttemptsOption = Annotated[int, typer.Option("--attempts", help="Poses to test at the most.", min=1)]
DeadlineOption = Annotated[
    float | None, typer.Option("--deadline", help="s; the best found by then is taken.", show_default=False)
]
CandidatesOption = Annotated[
    int, typer.Option("--candidates", help="Placements to find before the best is taken.", min=1)
]
CriterionOption = Annotated[str, typer.Option("--criterion", help=f"What is best: {', '.join(CRITERIA)}.")]
OnOption = Annotated[str, typer.Option("--on", help="What may carry it: any, objects or fixed.")]
RobustOption = Annotated[
    bool, typer.Option("--robust", help="It has to stay in spite of 2 mm, 2 degrees, 20 % friction, 10 % mass.")
]
RefiningOption = Annotated[bool, typer.Option("--refine", help="Then move it as long as it gets better.")]
OutputOption = Annotated[
    Path | None,
    typer.Option("--save", metavar="FILE", help="Write the scene with the object in it.", show_default=False),
]
JsonOption = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE", help="Write the answer as JSON; - for stdout.", show_default=False),
]


def place(
    scene: SceneArgument,
    spec: SpecOption,
    seed: SeedOption = 0,
    attempts: AttemptsOption = 500,
    deadline: DeadlineOption = None,
    candidates: CandidatesOption = 1,
    criterion: CriterionOption = "least",
    on: OnOption = "any",
    robust: RobustOption = False,
    refining: RefiningOption = False,
    output: OutputOption = None,
    json_target: JsonOption = None,
) -> None:
    """Where does this object stay?

    The answer is the pose of the object's frame in the scene, and the least force on the surface of any object that
    moves something afterwards.

    Example:  poise place scene.yaml --object '{id: mug, cylinder: [0.04, 0.1], mass: 0.3}' --json answer.json
    """
    refuse_folder(json_target, "--json")
    item = _read_spec(spec)
    analysis = open_scene(scene)
    options = Options(
        attempts, deadline, candidates, criterion, on, uncertainty=Uncertainty() if robust else None, refining=refining
    )
    people = console(json_target)
    try:
        with Bar(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=people) as bar:
            task = bar.add_task("looking", total=None)

            def tell(progress: Progress) -> bool:
                found = "" if progress.best is None else ", one that stays is found"
                bar.update(task, description=f"pose {progress.iteration} of up to {attempts}{found}")
                return True

            found = plan_placement(analysis, item, options, seed, tell)
    except NoAnswerError as error:
        answer = {"error": error.code.name, "code": int(error.code), "message": error.message, **error.data}
        write_json(json_target, answer)
        raise
    write_json(json_target, _content(found))
    if output is not None:
        write_scene(found.analysis.assembly, output)
    x, y, z, *quaternion = found.pose.vector
    people.print(f"{item.id} stays at x {x:.4f} y {y:.4f} z {z:.4f} m, quaternion {np.round(quaternion, 4).tolist()}")
    people.print(f"least robustness of the assembly then: {found.merit.least:.3g} N")
    rejected = ", ".join(f"{count} {why}" for why, count in found.rejected.items())
    people.print(f"{found.iterations} poses tested{f' ({rejected})' if rejected else ''} in {found.seconds:.2f} s")


def _content(found: Placement) -> dict[str, Any]:
    least = found.merit.least
    return {
        "pose": found.pose.vector,
        "robustness": least if np.isfinite(least) else "inf",
        "iterations": found.iterations,
        "seconds": found.seconds,
        "volume": found.merit.volume,
        "rejected": found.rejected,
    }


def _read_spec(spec: str) -> RigidObject:
    """An object entry from a file or from the text itself.

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, or what is wrong with the entry.
    """
    text, folder = spec, Path()
    path = Path(spec)
    if "{" not in spec and ":" not in spec:
        folder = path.parent
        try:
            if path.stat().st_size > MOST_BYTES:
                raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: too large for one object entry")
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise InputError(ErrorCode.FILE_UNREADABLE, f"--object {path}: {error.strerror or error}") from error
    try:
        content = yaml.safe_load(text)
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"--object: not YAML: {' '.join(str(error).split())}") from error
    if isinstance(content, dict):
        content.setdefault("id", "placed")
    return read_object(content, folder, "--object")
