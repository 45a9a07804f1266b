"""`poise robustness`, `poise msa`, `poise disassemble`: pushes, accelerations and disassembly of a scene file."""

import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from poise.assembly import Analysis, acceleration_limits, assess_settled, plan_disassembly, robustness_map
from poise.assembly.contact import CONTACT_MARGIN
from poise.assembly.robustness import (
    ROBUSTNESS_MODELS,
    SAMPLES,
    AccelerationLimits,
    RobustnessMap,
    UncertainAssessment,
    carried,
)
from poise.commands.assembly_pictures import (
    RerunOption,
    ScenePictureOption,
    draw_limits,
    draw_map,
    draw_pushes,
    refuse_folders,
)
from poise.commands.loads import LoadModelOption, LoadOption, LoadPoseOption, least_limits, loaded
from poise.commands.output import (
    JsonOption,
    console,
    finding_json,
    number_for_json,
    refuse_folder,
    warn,
    write_json,
)
from poise.commands.questions import Question, first_of, read_pushes, read_vectors
from poise.commands.scenes import (
    SceneArgument,
    TouchingOption,
    findings_json,
    open_scene,
    open_settled,
    prepared,
    refuse_falling,
)
from poise.commands.settling import (
    PoseStdOption,
    SamplesOption,
    interval_json,
    print_moves,
    print_samples,
    settled_json,
)
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.types import Array, Mask

_QUERIES_HELP = "JSON list of {object, point, direction}, or of lists of these: forces that grow in proportion."
_FROM_BELOW = "answers marked doubtful are lower bounds: elastic contacts were not seen to collapse beyond them"
_LATE = "the deadline passed: bounds marked doubtful were not checked by elastic contacts, and some are wide"
_MAP_SECONDS = 60.0
"""Deadline of a map when none is given: elastic contacts of large walls may take minutes."""
DeadlineOption = Annotated[
    float | None,
    typer.Option(
        "--deadline", help="Time limit, s; the bounds certified by then are returned.", show_default=False, min=0.0
    ),
]
_QueriesOption = Annotated[
    Path | None, typer.Option("--queries", metavar="FILE", help=_QUERIES_HELP, show_default=False)
]
_MapOption = Annotated[
    bool,
    typer.Option(
        "--map", help="Map inward pushes all over the surface instead (in 60 s, unless --deadline says otherwise)."
    ),
]


def robustness(
    scene: SceneArgument,
    queries: _QueriesOption = None,
    surface: _MapOption = False,
    points: Annotated[int, typer.Option("--points", help="Points of the map.", min=1, max=1_000_000)] = 10_000,
    tolerance: Annotated[
        float, typer.Option("--tolerance", help="Relative tolerance of the map.", min=1e-4, max=1.0)
    ] = 0.03,
    model: Annotated[
        str | None, typer.Option("--model", help=f"Contact model: {', '.join(ROBUSTNESS_MODELS.names())}.")
    ] = None,
    deadline: DeadlineOption = None,
    pose_std: PoseStdOption = None,
    samples: SamplesOption = SAMPLES,
    touching: TouchingOption = CONTACT_MARGIN,
    json_target: JsonOption = None,
    picture: ScenePictureOption = None,
    rerun: RerunOption = None,
) -> None:
    """Compute the force that each object of a scene withstands before something moves.

    Without queries: whether the scene stands by itself, and by what margin. `--map` writes SCENE_map.json unless
    `--json` names another file. The picture shows the map, how the weakest push moves things, or what touches what.
    Uncertain poses (`pose_std` in the scene, or --pose-std) are settled until things touch; answers have intervals.

    Example:  poise robustness scene.yaml --queries pushes.json --json answer.json --picture weakest.png
    """
    refuse_folders(json_target, picture, rerun)
    if surface and queries is not None:
        raise InputError(ErrorCode.BAD_INPUT, "--queries and --map exclude each other; give one of them")
    settled = open_settled(scene, pose_std)
    analysis = prepared(settled, deadline, touching)
    if surface:
        found_map = robustness_map(analysis, points, tolerance, model, _MAP_SECONDS if deadline is None else deadline)
        _print_map(found_map, json_target or f"{scene.stem}_map.json", json_target)
        draw_map(found_map, picture, rerun, json_target)
        return
    pushes = [] if queries is None else read_pushes(queries)
    start = time.perf_counter()
    found = assess_settled(settled, pushes, model, deadline, samples if pushes else 0, analysis=analysis)
    content = _assessment_json(analysis, found, model, time.perf_counter() - start) | settled_json(settled, found)
    scene_json = findings_json(analysis)
    content["findings"] = [*content.get("findings", []), *scene_json, *_pushes_of_fixed(analysis, pushes)]
    write_json(json_target, content)
    print_moves(settled, json_target)
    _print_assessment(found, pushes, json_target)
    moved = [first_of(question) for question in carried(pushes, settled.seen, settled.assembly)]
    draw_pushes(analysis, moved, found.settled, picture, rerun, json_target)
    refuse_falling(settled, found.settled)


def msa(
    scene: SceneArgument,
    directions: Annotated[
        str,
        typer.Option("--directions", metavar="FILE_OR_N", help="JSON list of [x, y, z], or a number of azimuths."),
    ] = "72",
    load: LoadOption = None,
    model: LoadModelOption = None,
    load_pose: LoadPoseOption = None,
    turning: Annotated[bool, typer.Option(help="Limits of turning, too, which take a part of the time.")] = True,
    deadline: DeadlineOption = None,
    pose_std: PoseStdOption = None,
    touching: TouchingOption = CONTACT_MARGIN,
    json_target: JsonOption = None,
    picture: ScenePictureOption = None,
    rerun: RerunOption = None,
) -> None:
    """Compute the maximum safe acceleration of a base in each direction.

    With --load and --model one object weighs what a diagnosis says, and `cautious_limits` hold for all that it may
    weigh within two sigmas.

    Example:  poise msa scene.yaml --directions 8 --json limits.json --picture limits.png
    """
    refuse_folders(json_target, picture, rerun)
    wanted = int(directions) if directions.isdecimal() else read_vectors(Path(directions))
    analysis, others = loaded(open_scene(scene, pose_std, deadline, touching), load, model, load_pose)
    start = time.perf_counter()
    found = acceleration_limits(analysis, wanted, deadline, turning)
    cautious, cautious_doubtful = least_limits(found, others, deadline)
    seconds = time.perf_counter() - start
    tilts = found.tilts(float(np.linalg.norm(analysis.assembly.gravity)))
    content = _limits_json(found, tilts, cautious, cautious_doubtful, seconds)
    write_json(json_target, content | {"findings": findings_json(analysis)})
    people = console(json_target)
    table = Table("direction", "limit m/s2", "tilt rad", "moves first")
    rows = zip(found.directions, found.limits, tilts, found.first_to_move, found.doubtful.tolist(), strict=True)
    for direction, limit, tilt, names, doubtful in rows:
        way = " ".join(f"{value:.3f}" for value in direction)
        table.add_row(way, f"{limit:.3f}{_mark(doubtful)}", f"{tilt:.3f}", escape(", ".join(names)))
    people.print(table)
    if not found.complete:
        warn(_LATE)
    elif found.doubtful.any():
        warn(_FROM_BELOW)
    if turning:
        people.print(f"turning: {found.angular_acceleration:.3f} rad/s2, {found.angular_speed:.3f} rad/s")
    draw_limits(analysis, found, picture, rerun, json_target)


def _if_asked(value: float) -> float | str | None:
    """A limit of turning for JSON: None where none was asked for."""
    return None if np.isnan(value) else number_for_json(value)


def _mark(doubtful: bool) -> str:
    return " doubtful" if doubtful else ""


def _limits_json(
    found: AccelerationLimits, tilts: Array, cautious: Array, cautious_doubtful: Mask, seconds: float
) -> dict[str, Any]:
    return {
        "directions": found.directions,
        "tilts": tilts,
        "limits": [number_for_json(value) for value in found.limits],
        "cautious_limits": [number_for_json(value) for value in cautious],
        "cautious_doubtful": cautious_doubtful,
        "first_to_move": found.first_to_move,
        "seconds": seconds,
        "normals": found.normals,
        "offsets": found.offsets,
        "angular_acceleration": _if_asked(found.angular_acceleration),
        "angular_speed": _if_asked(found.angular_speed),
        "doubtful": found.doubtful,
        "complete": found.complete,
    }


def disassemble(
    scene: SceneArgument,
    target: Annotated[
        str | None,
        typer.Option("--target", help="Remove this object, and those that must go first.", show_default=False),
    ] = None,
    deadline: DeadlineOption = None,
    pose_std: PoseStdOption = None,
    touching: TouchingOption = CONTACT_MARGIN,
    json_target: JsonOption = None,
) -> None:
    """Find an order in which a scene can be taken apart without moving other objects.

    Example:  poise disassemble scene.yaml
    """
    refuse_folder(json_target, "--json")
    analysis = open_scene(scene, pose_std, deadline, touching)
    found = plan_disassembly(analysis, target, deadline)
    margins = [number_for_json(value) for value in found.margins]
    content: dict[str, Any] = {"order": found.order, "safe": found.safe, "margins": margins, "ways": found.ways}
    content["complete"] = found.complete
    content["reason"] = found.reason or None
    content["findings"] = findings_json(analysis)
    write_json(json_target, content)
    table = Table("take", "safe", "margin left N", "way out")
    for name, safe, margin, way in zip(found.order, found.safe, found.margins, found.ways, strict=True):
        along = "none found" if way is None else " ".join(f"{value:.2f}" for value in way + 0.0)
        table.add_row(escape(name), "yes" if safe else "no", f"{margin:.3f}", along, style=None if safe else "red")
    console(json_target).print(table)
    if found.reason:
        console(json_target).print(f"Not all steps are safe: {found.reason}.", markup=False)


def _pushes_of_fixed(analysis: Analysis, pushes: list[Question]) -> list[dict[str, Any]]:
    """Findings about pushes on objects that no force moves."""
    places = [analysis.assembly.place_of(first_of(question).object) for question in pushes]
    fixed = sorted({analysis.assembly.objects[place].id for place in places if analysis.assembly.objects[place].fixed})
    sentences = [f"{name} is fixed: no push on it moves anything" for name in fixed]
    for sentence in sentences:
        warn(sentence)
    return [finding_json(ErrorCode.IMPLAUSIBLE, sentence, {}) for sentence in sentences]


def _assessment_json(
    analysis: Analysis, uncertain: UncertainAssessment, model: str | None, seconds: float
) -> dict[str, Any]:
    objects, found = analysis.assembly.objects, uncertain.settled
    return {
        "stable": found.stable,
        "doubtful": found.doubtful,
        "margin": number_for_json(found.margin),
        "falling": found.falling,
        "model": model or "default",
        "queries": [
            {
                "robustness": number_for_json(result.robustness),
                "lower": number_for_json(result.lower),
                "upper": number_for_json(result.upper),
                "mode": result.mode,
                "moves": result.moves,
                "mechanism": result.mechanism,
                "checked": result.checked,
                "doubtful": result.doubtful,
            }
            | ({"interval": interval_json(uncertain, number)} if uncertain.samples else {})
            for number, result in enumerate(found.results)
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
        "lower": [number_for_json(value) for value in found.lower.tolist()],
        "upper": [number_for_json(value) for value in found.upper.tolist()],
        "doubtful": found.doubtful,
        "complete": found.complete,
        "solves": found.solves,
        "seconds": found.seconds,
        "findings": findings_json(found.analysis),
    }


def _print_assessment(uncertain: UncertainAssessment, pushes: list[Question], json_target: str | None) -> None:
    people, found = console(json_target), uncertain.settled
    stable = "not checked in time (doubtful)" if found.doubtful else "yes" if found.stable else "no"
    people.print(f"stable: {stable}, margin {found.margin:.4g} N")
    if not found.complete:
        warn(_LATE)
    if not (found.stable or found.doubtful) or not pushes:
        return
    table = Table("object", "robustness N", "bounds N", *(["interval N"] if uncertain.samples else []), "mode", "moves")
    for push, result, *ends in zip(pushes, found.results, uncertain.lower, uncertain.upper, strict=True):
        bounds = f"{result.lower:.4g} to {result.upper:.4g}{_mark(result.doubtful)}"
        interval = [f"{ends[0]:.4g} to {ends[1]:.4g}"] if uncertain.samples else []
        moves = escape(", ".join(result.moves))
        name = escape(first_of(push).object)
        table.add_row(name, f"{result.robustness:.4g}", bounds, *interval, result.mode, moves)
    people.print(table)
    if found.complete and any(result.doubtful for result in found.results):
        warn(_FROM_BELOW)
    print_samples(uncertain, json_target)


def _print_map(found: RobustnessMap, target: str, json_target: str | None) -> None:
    write_json(target, _map_json(found))
    people = console(json_target)
    if not len(found.upper):
        raise NoAnswerError(ErrorCode.EMPTY, "the scene has no movable surface to push")
    weakest = int(found.lower.argmin())
    name = found.analysis.assembly.objects[found.surface.place[weakest]].id
    place = ", ".join(f"{value:.3f}" for value in found.surface.points[weakest])
    people.print(
        f"{len(found.upper)} points, {found.solves} solved, {found.seconds:.3f} s; "
        f"weakest {found.lower[weakest]:.4g} to {found.upper[weakest]:.4g} N on {escape(name)} at ({place})"
    )
    if found.doubtful.any():
        share = found.doubtful.mean()
        warn(f"{share:.0%} of the points are doubtful: only their lower bounds hold")
    if not found.complete:
        warn(_LATE)
    people.print(f"written: {escape(target)}", soft_wrap=True)
