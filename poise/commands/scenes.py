"""How commands open a scene file: prepared for many questions, with warnings about repaired meshes."""

from pathlib import Path
from typing import Annotated

import typer

from poise.assembly import Analysis, load_scene
from poise.commands.output import warn

SceneArgument = Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file (YAML).", show_default=False)]


def open_scene(path: Path) -> Analysis:
    """The analysis of the scene in a file.

    Raises:
        InputError: as `load_scene`; INTERPENETRATION, FLOATING.
    """
    assembly = load_scene(path)
    for note in assembly.notes:
        warn(note)
    return Analysis.of(assembly)
