"""How commands open a scene file: prepared for many questions, with warnings about what was repaired or moved."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from poise.assembly import Analysis, Settled, load_scene, settle
from poise.assembly.scene import with_pose_covariance
from poise.commands.output import warn
from poise.commands.settling import read_pose_std, warn_of_moves

SceneArgument = Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file (YAML).", show_default=False)]


def open_scene(path: Path, pose_std: str | None = None) -> Analysis:
    """The analysis of the scene in a file, settled if its poses are uncertain.

    Raises:
        InputError: as `open_settled`.
    """
    return Analysis.of(open_settled(path, pose_std).assembly)


def open_settled(path: Path, pose_std: str | None = None) -> Settled:
    """The scene in a file, settled if its poses are uncertain, by themselves or by the words of `--pose-std`.

    Raises:
        InputError: as `load_scene` and `settle`; INTERPENETRATION, FLOATING.
    """
    assembly = load_scene(path)
    for note in assembly.notes:
        warn(note)
    if pose_std is not None:
        objects = with_pose_covariance(assembly.objects, read_pose_std(pose_std))
        assembly = replace(assembly, objects=objects)
    settled = settle(assembly)
    warn_of_moves(settled)
    return settled
