"""`poise scene`: worlds of simulators and planning scenes of MoveIt as scene files, and back."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import yaml
from rich.table import Table

from poise.assembly import Assembly
from poise.assembly.scene import scene_findings
from poise.commands.output import JsonOption, console, refuse_folder, warn, write_json
from poise.commands.scenes import scene_findings_json
from poise.errors import ErrorCode, InputError
from poise.ranges import check_range
from poise.worlds import read_world, write_world

SourceArgument = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="SDFormat, MJCF, URDF, a PlanningScene, or a scene file.", show_default=False),
]
TargetOption = Annotated[
    Path | None,
    typer.Option(
        "--output",
        metavar="FILE",
        help=".yaml (a scene file), .sdf, .xml (MJCF), .scene (RViz) or .json (PlanningScene).",
        show_default=False,
    ),
]
MassesOption = Annotated[
    Path | None,
    typer.Option("--masses", metavar="FILE", help="YAML with `id: kg`; replaces the masses.", show_default=False),
]
FrictionOption = Annotated[
    float | None,
    typer.Option("--friction", help="Coulomb coefficient of all pairs, instead of the file's.", show_default=False),
]
FloorOption = Annotated[
    float | None, typer.Option("--floor", metavar="Z", help="Add a fixed floor at this height, m.", show_default=False)
]


def scene(
    source: SourceArgument,
    output: TargetOption = None,
    masses: MassesOption = None,
    friction: FrictionOption = None,
    floor: FloorOption = None,
    json_target: JsonOption = None,
) -> None:
    """Convert a world of Gazebo, MuJoCo, URDF or MoveIt into a scene file, or a scene into one.

    The other commands read these files, too; convert a file to look at it, and to add masses and friction.

    Example:  poise scene world.sdf --output scene.yaml

    Example:  poise scene scene.yaml --output world.xml   # then: python -m mujoco.viewer --mjcf world.xml
    """
    refuse_folder(json_target, "--json")
    if friction is not None:
        check_range("friction", friction, "--friction: ")
    if floor is not None:
        check_range("position", floor, "--floor: ")
    assembly, notes = read_world(source, _read_masses(masses), friction, floor)
    notes = (*notes, *assembly.notes)
    lost: tuple[str, ...] = ()
    if output is not None:
        lost = write_world(assembly, output)
    for note in (*notes, *(found.sentence for found in scene_findings(assembly))):
        warn(note)
    for each in lost:
        warn(f"not written: {each}")
    write_json(json_target, _content(assembly, notes, lost))
    console(json_target).print(_table(assembly))


def _read_masses(path: Path | None) -> dict[str, float]:
    if path is None:
        return {}
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict) or not all(isinstance(value, int | float) for value in content.values()):
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: expected a line `id: kg` for each object")
    return {str(name): float(value) for name, value in content.items()}


def _content(assembly: Assembly, notes: tuple[str, ...], lost: tuple[str, ...]) -> dict[str, Any]:
    objects = [
        {
            "id": item.id,
            "shape": type(item.shape).__name__.lower(),
            "fixed": item.fixed,
            "mass": None if item.fixed else item.mass,
            "pose": item.pose.vector.tolist(),
        }
        for item in assembly.objects
    ]
    return {
        "objects": objects,
        "friction": assembly.friction,
        "notes": list(notes),
        "not_written": list(lost),
        "findings": scene_findings_json(assembly),
    }


def _table(assembly: Assembly) -> Table:
    table = Table("object", "shape", "mass, kg", "x, y, z, m")
    for item in assembly.objects:
        size = " x ".join(f"{side:.3g}" for side in np.ptp(item.shape.polyhedron.vertices, axis=0))
        mass = "fixed" if item.fixed else f"{item.mass:.4g}"
        place = ", ".join(f"{value:.4g}" for value in item.pose.translation)
        table.add_row(item.id, f"{type(item.shape).__name__.lower()}, {size} m", mass, place)
    return table
