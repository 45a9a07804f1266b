"""`poise robustness`, `poise msa` and `poise disassemble`: what a scene file of objects in contact bears."""

import json
import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from poise.assembly import (
    MODELS,
    Analysis,
    Assessment,
    Push,
    RobustnessMap,
    acceleration_limits,
    assess,
    load_scene,
    plan_disassembly,
    robustness_map,
)
from poise.commands.assembly_pictures import (
    PictureOption,
    RerunOption,
    draw_limits,
    draw_map,
    draw_pushes,
    refuse_folders,
)
from poise.commands.output import console, refuse_folder, warn, write_json
from poise.errors import ErrorCode, InputError, NoAnswerError

SceneArgument = Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file (YAML).", show_default=False)]
JsonOption = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE", help="Write the answer as JSON; - for stdout.", show_default=False),
]
DeadlineOption = Annotated[
    float | None,
    typer.Option("--deadline", help="s; what is certified by then is returned.", show_default=False, min=0.0),
]
MAX_QUERIES_BYTES = 100_000_000


def robustness(
    scene: SceneArgument,
    queries: Annotated[
        Path | None,
        typer.Option("--queries", metavar="FILE", help="JSON list of {object, point, direction}.", show_default=False),
    ] = None,
    surface: Annotated[bool, typer.Option("--map", help="Pushes inward all over the surface instead.")] = False,
    points: Annotated[int, typer.Option("--points", help="Of the map.", min=1, max=1_000_000)] = 10_000,
    tolerance: Annotated[float, typer.Option("--tolerance", help="Of the map, relative.", min=1e-4, max=1.0)] = 0.03,
    model: Annotated[str | None, typer.Option("--model", help=f"One of {', '.join(sorted(MODELS))}.")] = None,
    deadline: DeadlineOption = None,
    json_target: JsonOption = None,
    picture: PictureOption = None,
    rerun: RerunOption = None,
) -> None:
    """How hard may each of these be pushed before something slips or topples?

    Without queries: whether the scene stands by itself, and by what margin. `--map` writes SCENE_map.json unless
    `--json` names another file. The picture shows the map, how the weakest push moves things, or what touches what.

    Example:  poise robustness scene.yaml --queries pushes.json --json answer.json --picture weakest.png
    """
    refuse_folders(json_target, picture, rerun)
    if surface and queries is not None:
        raise InputError(ErrorCode.BAD_INPUT, "--queries and --map ask different questions; give one of them")
    analysis = Analysis.of(load_scene(scene))
    if surface:
        found_map = robustness_map(analysis, points, tolerance, model, deadline)
        target = json_target or f"{scene.stem}_map.json"
        write_json(target, _map_json(found_map))
        _print_map(found_map, target, json_target)
        draw_map(found_map, picture, rerun, json_target)
        return
    pushes = [] if queries is None else read_pushes(queries)
    start = time.perf_counter()
    found = assess(analysis, pushes, model, deadline)
    seconds = time.perf_counter() - start
    write_json(json_target, _assessment_json(analysis, found, model, seconds))
    _print_assessment(found, pushes, json_target)
    if not found.complete:
        warn("the deadline passed: some bounds are wide")
    draw_pushes(analysis, pushes, found, picture, rerun, json_target)
    analysis.require_stable()


def msa(
    scene: SceneArgument,
    directions: Annotated[
        str,
        typer.Option("--directions", metavar="FILE_OR_N", help="JSON list of [x, y, z], or how many in the plane."),
    ] = "72",
    deadline: DeadlineOption = None,
    json_target: JsonOption = None,
    picture: PictureOption = None,
    rerun: RerunOption = None,
) -> None:
    """How fast may a base accelerate before something on it slips or topples?

    Example:  poise msa scene.yaml --directions 8 --json limits.json --picture limits.png
    """
    refuse_folders(json_target, picture, rerun)
    wanted = int(directions) if directions.isdecimal() else _vectors(Path(directions))
    analysis = Analysis.of(load_scene(scene))
    start = time.perf_counter()
    found = acceleration_limits(analysis, wanted, deadline)
    seconds = time.perf_counter() - start
    content = {
        "directions": found.directions,
        "limits": [_number(value) for value in found.limits],
        "first_to_move": found.first_to_move,
        "seconds": seconds,
        "normals": found.normals,
        "offsets": found.offsets,
        "angular_acceleration": _number(found.angular_acceleration),
        "angular_speed": _number(found.angular_speed),
        "complete": found.complete,
    }
    write_json(json_target, content)
    people = console(json_target)
    table = Table("direction", "limit m/s2", "moves first")
    for direction, limit, names in zip(found.directions, found.limits, found.first_to_move, strict=True):
        table.add_row(" ".join(f"{value:.3f}" for value in direction), f"{limit:.3f}", escape(", ".join(names)))
    people.print(table)
    people.print(f"turning: {found.angular_acceleration:.3f} rad/s2, {found.angular_speed:.3f} rad/s")
    draw_limits(analysis, found, picture, rerun, json_target)


def disassemble(
    scene: SceneArgument,
    target: Annotated[
        str | None,
        typer.Option("--target", help="Take this object only, and what has to go first.", show_default=False),
    ] = None,
    deadline: DeadlineOption = None,
    json_target: JsonOption = None,
) -> None:
    """In which order can a scene be taken apart without anything else moving?

    Example:  poise disassemble scene.yaml
    """
    refuse_folder(json_target, "--json")
    analysis = Analysis.of(load_scene(scene))
    found = plan_disassembly(analysis, target, deadline)
    margins = [_number(value) for value in found.margins]
    content = {"order": found.order, "safe": found.safe, "margins": margins, "complete": found.complete}
    write_json(json_target, content)
    table = Table("take", "safe", "margin left N")
    for name, safe, margin in zip(found.order, found.safe, found.margins, strict=True):
        table.add_row(escape(name), "yes" if safe else "no", f"{margin:.3f}", style=None if safe else "red")
    console(json_target).print(table)


def read_pushes(path: Path) -> list[Push]:
    """Read a JSON list of {object, point [3], direction [3]}, in the scene's frame.

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, or BAD_INPUT naming the entry.
    """
    pushes = []
    for number, entry in enumerate(_json_list(path)):
        if not isinstance(entry, dict) or {"object", "point", "direction"} - set(entry):
            raise InputError(ErrorCode.BAD_INPUT, f"{path}: entry {number} needs object, point and direction")
        if not isinstance(entry["object"], str):
            raise InputError(
                ErrorCode.BAD_INPUT, f"{path}: entry {number}: object is {entry['object']!r}, expected an id"
            )
        pushes.append(Push(entry["object"], entry["point"], entry["direction"]))
    return pushes


def _vectors(path: Path) -> "np.typing.NDArray[np.float64]":
    try:
        return np.array(_json_list(path), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: expected a list of [x, y, z]") from error


def _json_list(path: Path) -> list[Any]:
    try:
        if path.stat().st_size > MAX_QUERIES_BYTES:
            raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: larger than {MAX_QUERIES_BYTES // 1_000_000} MB")
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: not JSON: {error}") from error
    if not isinstance(content, list):
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: expected a list, found {type(content).__name__}")
    return content


def _number(value: float) -> float | str:
    """JSON has no infinity: the contract writes it as a word."""
    return float(value) if np.isfinite(value) else "inf" if value > 0 else "-inf"


def _assessment_json(analysis: Analysis, found: Assessment, model: str | None, seconds: float) -> dict[str, Any]:
    objects = analysis.assembly.objects
    return {
        "stable": found.stable,
        "margin": _number(found.margin),
        "falling": found.falling,
        "model": model or "default",
        "queries": [
            {
                "robustness": _number(result.robustness),
                "lower": _number(result.lower),
                "upper": _number(result.upper),
                "mode": result.mode,
                "moves": result.moves,
                "mechanism": result.mechanism,
                "checked": result.checked,
            }
            for result in found.results
        ],
        "seconds": seconds,
        "complete": found.complete,
        "contacts": [
            {
                "objects": [objects[interface.first].id, objects[interface.second].id],
                "area": interface.area,
                "gap": interface.gap,
            }
            for interface in analysis.structure.interfaces
        ],
    }


def _map_json(found: RobustnessMap) -> dict[str, Any]:
    objects = found.analysis.assembly.objects
    return {
        "objects": [objects[place].id for place in found.surface.place.tolist()],
        "points": found.surface.points,
        "directions": found.surface.directions,
        "lower": [_number(value) for value in found.lower.tolist()],
        "upper": [_number(value) for value in found.upper.tolist()],
        "complete": found.complete,
        "solves": found.solves,
        "seconds": found.seconds,
    }


def _print_assessment(found: Assessment, pushes: list[Push], json_target: str | None) -> None:
    people = console(json_target)
    people.print(f"stands: {'yes' if found.stable else 'no'}, margin {found.margin:.4g} N")
    if not found.stable or not pushes:
        return
    table = Table("object", "robustness N", "bounds N", "mode", "moves")
    for push, result in zip(pushes, found.results, strict=True):
        bounds = f"{result.lower:.4g} to {result.upper:.4g}"
        moves = escape(", ".join(result.moves))
        table.add_row(escape(push.object), f"{result.robustness:.4g}", bounds, result.mode, moves)
    people.print(table)


def _print_map(found: RobustnessMap, target: str, json_target: str | None) -> None:
    people = console(json_target)
    if not len(found.upper):
        raise NoAnswerError(ErrorCode.EMPTY, "the scene has no movable surface to push")
    weakest = int(found.upper.argmin())
    name = found.analysis.assembly.objects[found.surface.place[weakest]].id
    place = ", ".join(f"{value:.3f}" for value in found.surface.points[weakest])
    people.print(
        f"{len(found.upper)} points, {found.solves} solved, {found.seconds:.3f} s; "
        f"weakest {found.upper[weakest]:.4g} N on {escape(name)} at ({place})"
    )
    if not found.complete:
        warn("the deadline passed: some bounds are wide")
    people.print(f"written: {escape(target)}", soft_wrap=True)
