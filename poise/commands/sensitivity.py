"""`poise sensitivity`: derivatives of the robustness to a push, and the probability of motion."""

import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.progress import Progress

from poise.assembly import Push, motion_probability
from poise.assembly import sensitivity as sensitivity_of
from poise.assembly.robustness import MotionProbability, Sensitivity
from poise.commands.assembly import DeadlineOption
from poise.commands.output import JsonOption, console, number_for_json, refuse_folder, write_json
from poise.commands.questions import read_pushes
from poise.commands.scenes import SceneArgument, open_scene
from poise.errors import ErrorCode, InputError


def sensitivity(
    scene: SceneArgument,
    queries: Annotated[
        Path, typer.Option("--queries", metavar="FILE", help="JSON list of {object, point, direction}.")
    ],
    force: Annotated[
        float | None,
        typer.Option("--force", help="N; also: the probability that it moves anything.", min=0.0),
    ] = None,
    friction_deviation: Annotated[
        float, typer.Option("--friction-deviation", help="One sigma, if the scene has none.", min=0.0)
    ] = 0.0,
    pose_deviation: Annotated[float, typer.Option("--pose-deviation", help="m, normal to gravity.", min=0.0)] = 0.0,
    samples: Annotated[int, typer.Option("--samples", help="Samples for --force.", min=1, max=1_000_000)] = 1000,
    seed: Annotated[int, typer.Option("--seed", help="Random seed.", min=0)] = 0,
    deadline: DeadlineOption = None,
    json_target: JsonOption = None,
) -> None:
    """Differentiate robustness with respect to masses, poses, friction and the push.

    Exact derivatives of limit analysis; doubtful where contacts hold less than that allows. With --force: the
    probability that a push this hard moves anything, given the covariances and deviations in the scene.

    Example:  poise sensitivity scene.yaml --queries pushes.json --force 3 --friction-deviation 0.05
    """
    refuse_folder(json_target, "--json")
    analysis = open_scene(scene, deadline=deadline)
    pushes = read_pushes(queries)
    single = [push for push in pushes if isinstance(push, Push)]
    if len(single) < len(pushes):
        raise InputError(ErrorCode.BAD_INPUT, f"{queries}: sensitivity takes single pushes, not lists of them")
    start = time.perf_counter()
    content: list[dict[str, Any]] = []
    with Progress(console=console("-"), transient=True) as bar:
        for push in bar.track(single, description="pushes"):
            found, sure = sensitivity_of(analysis, push, deadline), None
            if force is not None:
                sure = motion_probability(
                    analysis.assembly,
                    push,
                    force,
                    np.random.default_rng(seed),
                    samples,
                    friction_deviation,
                    pose_deviation,
                    deadline,
                )
            content.append(_as_json(found, sure))
            _print(push, found, sure, json_target)
    write_json(json_target, {"queries": content, "seconds": time.perf_counter() - start})


def _as_json(found: Sensitivity, sure: MotionProbability | None) -> dict[str, Any]:
    content: dict[str, Any] = {
        "robustness": number_for_json(found.robustness),
        "limit": number_for_json(found.limit),
        "doubtful": found.doubtful,
        "mass": found.mass,
        "com": found.com,
        "friction": [{"objects": pair, "derivative": value} for pair, value in found.friction.items()],
        "point": found.point,
    }
    if sure is not None:
        content["probability"] = sure.probability
        content["deviation"] = sure.deviation
        content["moves"] = sure.moves
        content["samples"] = sure.samples
        content["complete"] = sure.complete
    return content


def _print(push: Push, found: Sensitivity, sure: MotionProbability | None, json_target: str | None) -> None:
    people = console(json_target)
    doubt = f", doubtful: the derivatives are those of limit analysis, {found.limit:.4g} N" if found.doubtful else ""
    people.print(f"{escape(push.object)}: {found.robustness:.4g} N{doubt}")
    for name, value in sorted(found.mass.items(), key=lambda entry: -abs(entry[1])):
        people.print(f"  mass of {escape(name)}: {value:.4g} N/kg")
    for pair, value in sorted(found.friction.items(), key=lambda entry: -abs(entry[1])):
        people.print(f"  friction between {escape(pair[0])} and {escape(pair[1])}: {value:.4g} N per unit")
    if sure is not None:
        people.print(f"  moves with probability {sure.probability:.4g} ± {sure.deviation:.2g}")
