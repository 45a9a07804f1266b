"""`poise segment`: the parts of an object, from a cloud of points on its surface."""

import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from poise.commands.output import console, refuse_folders, warn, write_json
from poise.errors import ErrorCode, InputError
from poise.files import write_whole
from poise.shape import (
    CheckedMesh,
    Cloud,
    Segmentation,
    SegmentationOptions,
    labelled_ply,
    read_surface,
    segment_surface,
    surface_ply,
)
from poise.types import Array

CloudArgument = Annotated[
    Path,
    typer.Argument(metavar="CLOUD", help="PLY, PCD, XYZ, CSV or NPY, with colours or without; or a mesh: STL, OBJ."),
]
NumberOption = Annotated[
    int | None, typer.Option(min=1, max=100, help="Cut into so many parts (default: as found).", show_default=False)
]
ColourOption = Annotated[
    str, typer.Option("--colour", metavar="on|off", help="Whether colours say where materials meet.")
]
NoiseOption = Annotated[
    float | None,
    typer.Option(
        "--noise",
        min=0.0,
        max=0.05,
        help="One sigma of the points along each axis, m (default: estimated from them).",
        show_default=False,
    ),
]


def segment(
    cloud: CloudArgument,
    scale: Annotated[float, typer.Option("--scale", help="m per unit of the file (0.001 for mm).")] = 1.0,
    parts: NumberOption = None,
    colour: ColourOption = "on",
    noise: NoiseOption = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="PNG", help="Draw the parts.", show_default=False)
    ] = None,
    ply: Annotated[
        Path | None,
        typer.Option("--ply", metavar="PLY", help="Write the points with their parts as colours.", show_default=False),
    ] = None,
    surface: Annotated[
        Path | None,
        typer.Option("--surface", metavar="PLY", help="Write the closed surface with its parts.", show_default=False),
    ] = None,
    json_target: Annotated[
        str | None,
        typer.Option("--json", metavar="FILE", help="Write the answer as JSON; - for stdout.", show_default=False),
    ] = None,
) -> None:
    """Segment a surface point cloud or a closed mesh into parts and compute their volumes.

    The cloud has to show the object from all sides. What is nearly convex and of one colour becomes one part. The
    JSON holds a label per row of the file; -1 where a row was no point (NaN). For a mesh it holds one per triangle.

    Example:  poise segment hammer.ply --picture hammer.png --json hammer.json
    """
    refuse_folders({"--json": json_target, "--picture": picture, "--ply": ply, "--surface": surface})
    people = console(json_target)
    with people.status("reading the cloud and cutting it into parts"):
        start = time.perf_counter()
        read, mesh = read_surface(cloud, scale)
        found = segment_surface(read, mesh, segmentation_options(parts, noise), shades(colour, read.colours))
    answer = as_json(cloud, read, found, time.perf_counter() - start)
    for note in answer["notes"]:
        warn(note)
    write_json(json_target, answer)
    written = [
        *([] if ply is None else [write_whole(ply, labelled_ply(read.points, found.labels))]),
        *([] if surface is None else [write_whole(surface, surface_ply(found))]),
        *([] if picture is None else [write_picture(picture, found, cloud.stem)]),
    ]
    people.print(_table(cloud, answer))
    people.print(f"{_words(read, mesh, found)}, {answer['seconds']:.2f} s")
    for path in written:
        people.print(f"written: {escape(str(path))}", soft_wrap=True)


def _words(cloud: Cloud, mesh: CheckedMesh | None, found: Segmentation) -> str:
    if mesh is not None:
        return f"{len(mesh.triangles)} triangles around {1e6 * mesh.volume:.5g} cm3"
    return f"{len(cloud.points)} points with {1e3 * found.noise:.2g} mm of noise"


def segmentation_options(parts: int | None, noise: float | None) -> SegmentationOptions:
    """How to cut, by the options of the command line."""
    return SegmentationOptions(parts=parts, noise=noise)


def shades(colour: str, colours: Array | None) -> Array | None:
    """The colours that count.

    Raises:
        InputError: BAD_INPUT for another word than on and off.
    """
    if colour not in ("on", "off"):
        raise InputError(ErrorCode.BAD_INPUT, f"--colour '{colour}': give on or off")
    return colours if colour == "on" else None


def as_json(path: Path, cloud: Cloud, found: Segmentation, seconds: float) -> dict[str, Any]:
    """The fields of the contract, and what else is known; m and m3."""
    return {
        "labels": cloud.spread(found.labels) if found.triangle_labels is None else found.triangle_labels,
        "n_parts": found.n_parts,
        "volume": found.volume,
        "seconds": seconds,
        "volume_std": found.volume_std,
        "volume_if_hollow": found.volume_if_hollow,
        "part_volumes": found.volumes,
        "part_centroids": found.centroids,
        "noise": found.noise,
        "n_points": len(cloud.points),
        "cloud": str(path),
        "notes": [*cloud.notes, *found.notes],
    }


def write_picture(path: Path, found: Segmentation, title: str) -> Path:
    """Draw the parts from two sides, by the file's ending (PNG, SVG, PDF).

    Raises:
        InputError: UNSUPPORTED for another ending, FILE_UNWRITABLE.
    """
    from poise.viewing import draw_parts  # drawing libraries load slowly: only now

    return write_whole(path, draw_parts([(title, found)], path.suffix))


def _table(path: Path, answer: dict[str, Any]) -> Table:
    total, spread = answer["volume"] * 1e6, answer["volume_std"] * 1e6
    table = Table(title=escape(f"{path.name}: {total:.4g} ± {spread:.2g} cm3"), title_justify="left")
    for heading in ("part", "cm3", "share", "centroid x", "y", "z mm"):
        table.add_column(heading, justify="right")
    for part, (volume, centroid) in enumerate(zip(answer["part_volumes"], answer["part_centroids"], strict=True)):
        middle = (f"{1e3 * value:.1f}" for value in centroid)
        table.add_row(str(part), f"{volume * 1e6:.4g}", f"{volume / answer['volume']:.1%}", *middle)
    return table
