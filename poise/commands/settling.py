"""Scenes with uncertain poses in commands: what was moved, and intervals over the uncertainty."""

import re
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from poise.assembly import Settled
from poise.assembly.robustness import UncertainAssessment
from poise.assembly.scene import pose_covariance_of
from poise.commands.output import console, finding_json, number_for_json, warn
from poise.errors import ErrorCode, InputError
from poise.ranges import check_range
from poise.types import Array

PoseStdOption = Annotated[
    str | None,
    typer.Option(
        "--pose-std",
        metavar="2mm,0.5deg",
        help="One sigma of each coordinate and each angle of the poses that state none; the scene is settled.",
        show_default=False,
    ),
]
SamplesOption = Annotated[
    int, typer.Option("--samples", help="Draws of what is uncertain, for intervals; 0: no intervals.", min=0)
]
_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "deg": 1.0, "rad": float(np.degrees(1))}
_STD = re.compile(r"\s*([0-9.eE+-]+)\s*(mm|cm|m)\s*,\s*([0-9.eE+-]+)\s*(deg|rad)\s*")


def read_pose_std(text: str) -> Array:
    """(6, 6) covariance of a pose from such words as `2mm,0.5deg`.

    Raises:
        InputError: BAD_INPUT.
    """
    found = _STD.fullmatch(text)
    try:
        position, degrees = (float(found[i]) * _UNITS[found[i + 1]] for i in (1, 3)) if found else (np.nan, np.nan)
    except ValueError:
        found = None
    if not found:
        raise InputError(
            ErrorCode.BAD_INPUT, f"--pose-std {text!r}: expected a length and an angle with units, such as 2mm,0.5deg"
        )
    check_range("position of pose_std", position, "--pose-std: ")
    check_range("rotation_deg of pose_std", degrees, "--pose-std: ")
    return pose_covariance_of(position, np.radians(degrees))


def warn_of_moves(settled: Settled) -> None:
    """One line on stderr about what was moved, and one about neighbours that may touch or not."""
    for sentence in settled.sentences:
        warn(sentence)


def settled_json(settled: Settled, found: UncertainAssessment) -> dict[str, Any]:
    """What was moved, and which neighbours may touch or not."""
    if settled.worst is None:
        return {}
    return {
        "settled": {
            "moves": [
                {
                    "object": move.id,
                    "translation": move.translation,
                    "rotation": move.rotation,
                    "sigmas": move.sigmas,
                    "pose": settled.assembly.objects[settled.assembly.index[move.id]].pose.vector,
                }
                for move in settled.moves
            ],
            "doubtful_pairs": [
                {"objects": pair, "probability": chance} for pair, chance in settled.doubtful_pairs.items()
            ],
            "samples": found.samples,
            "fallen": found.fallen,
            "refused": found.refused,
            "coverage": found.coverage,
            "taken_as_exact": found.taken_as_exact,
        },
        "findings": [finding_json(ErrorCode.POOR_FIT, settled.strained, {"strain": settled.strain})]
        if settled.strain > 1
        else [],
    }


def interval_json(found: UncertainAssessment, query: int) -> list[float | str]:
    """The interval of one query over the uncertainty."""
    return [number_for_json(float(found.lower[query])), number_for_json(float(found.upper[query]))]


def print_moves(settled: Settled, json_target: str | None) -> None:
    """A table of what was moved."""
    if not settled.moves:
        return
    table = Table("settled", "moved mm", "turned degrees", "sigma")
    for move in settled.moves:
        by = f"{np.linalg.norm(move.translation) * 1e3:.2f}", f"{np.degrees(np.linalg.norm(move.rotation)):.2f}"
        table.add_row(escape(move.id), *by, f"{move.sigmas:.1f}")
    console(json_target).print(table)


def print_samples(found: UncertainAssessment, json_target: str | None) -> None:
    """How the intervals came about; a warning where they are of less worth."""
    if not found.samples:
        return
    console(json_target).print(
        f"intervals over {found.samples} draws of what is uncertain: a further one is inside with {found.coverage:.0%}"
    )
    if found.reservation:
        warn(found.reservation)
    if found.fallen:
        warn(f"{found.fallen} other draws do not stand by themselves, and are left out")
    if found.settled.complete and not found.complete:
        warn("the deadline passed before all draws were assessed: intervals are less sure than usual")
