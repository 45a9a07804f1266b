"""How commands open a scene file: prepared for many questions, with warnings about what was repaired or moved."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from poise.assembly import Analysis, Assembly, Settled, settle
from poise.assembly.contact import CONTACT_MARGIN
from poise.assembly.robustness import (
    EXPLAINED,
    Assessment,
    balance_findings,
    gap_findings,
    likely_cause,
    rolling_findings,
)
from poise.assembly.scene import scene_findings, with_pose_covariance
from poise.assembly.statics import Deadline, unstable
from poise.commands.output import finding_json, warn
from poise.commands.settling import read_pose_std, warn_of_moves
from poise.errors import ErrorCode, PoiseError
from poise.worlds import read_world

SceneArgument = Annotated[
    Path,
    typer.Argument(
        metavar="SCENE",
        help="A scene file (YAML), or a world in SDFormat, MJCF, URDF or of MoveIt.",
        show_default=False,
    ),
]

TouchingOption = Annotated[
    float,
    typer.Option(
        "--touching", help="Gaps and overlaps up to this count as touching, m.", min=1e-6, max=0.01, show_default=True
    ),
]


def open_scene(
    path: Path, pose_std: str | None = None, deadline: float | None = None, touching: float = CONTACT_MARGIN
) -> Analysis:
    """The analysis of the scene in a file, settled if its poses are uncertain; `deadline`: s to find its contacts.

    Raises:
        InputError: as `open_settled`.
        NoAnswerError: DEADLINE.
    """
    return prepared(open_settled(path, pose_std), deadline, touching)


def prepared(settled: Settled, deadline: float | None = None, touching: float = CONTACT_MARGIN) -> Analysis:
    """The analysis of a settled scene; `deadline`: s to find its contacts, gaps up to `touching`, m, included.

    Raises:
        InputError: INTERPENETRATION, FLOATING.
        NoAnswerError: DEADLINE.
    """
    with _explaining(settled.seen):
        return Analysis.of(settled.assembly, touching, Deadline.after(deadline))


def refuse_falling(settled: Settled, found: Assessment) -> None:
    """Raise a NoAnswerError, UNSTABLE, for a scene that is known to fall, with a warning of the likely cause."""
    with _explaining(settled.seen):
        if not (found.stable or found.doubtful):
            raise unstable(found.falling, found.margin)


def open_settled(path: Path, pose_std: str | None = None) -> Settled:
    """The scene in a file, settled if its poses are uncertain, by themselves or by the words of `--pose-std`.

    Raises:
        InputError: as `read_world` and `settle`; INTERPENETRATION, FLOATING.
    """
    assembly, notes = read_world(path)
    for note in (*notes, *assembly.notes, *(found.sentence for found in scene_findings(assembly))):
        warn(note)
    if pose_std is not None:
        objects = with_pose_covariance(assembly.objects, read_pose_std(pose_std))
        assembly = replace(assembly, objects=objects)
    with _explaining(assembly):
        settled = settle(assembly)
    warn_of_moves(settled)
    return settled


@contextmanager
def _explaining(assembly: Assembly) -> Iterator[None]:
    """Warn of the likely cause where a scene as it was given is refused, or falls."""
    try:
        yield
    except PoiseError as error:
        if error.code in EXPLAINED and (cause := likely_cause(assembly)) is not None:
            warn(f"{cause}; it is refused as it is given")
        raise


def scene_findings_json(assembly: Assembly) -> list[dict[str, Any]]:
    """What is probably wrong in a scene, as the contract writes findings."""
    return [finding_json(ErrorCode.IMPLAUSIBLE, each.sentence, each.evidence) for each in scene_findings(assembly)]


def findings_json(analysis: Analysis) -> list[dict[str, Any]]:
    """What is probably wrong in a scene, and what rolls, balances or touches across gaps in it; warns of these.

    Args:
        analysis: whose stability is known.
    """
    rolls, others = rolling_findings(analysis), (*balance_findings(analysis), *gap_findings(analysis))
    for each in (*rolls, *others):
        warn(each.sentence)
    found = [finding_json(ErrorCode.CAN_ROLL, each.sentence, each.evidence) for each in rolls]
    found += [finding_json(ErrorCode.IMPLAUSIBLE, each.sentence, each.evidence) for each in others]
    return scene_findings_json(analysis.assembly) + found
