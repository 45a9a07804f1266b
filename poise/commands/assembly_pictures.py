"""What `--picture` and `--rerun` of the assembly commands draw; the drawing libraries load only then."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from poise.assembly import Analysis, Push
from poise.assembly.robustness import AccelerationLimits, Assessment, RobustnessMap
from poise.commands.output import console, refuse_folder

ScenePictureOption = Annotated[
    Path | None,
    typer.Option("--picture", metavar="FILE", help="Draw the answer: a PNG, SVG or PDF.", show_default=False),
]
RerunOption = Annotated[
    Path | None,
    typer.Option(
        "--rerun", metavar="FILE", help="Write the scene and the answer for the Rerun viewer.", show_default=False
    ),
]


def refuse_folders(json_target: str | None, picture: Path | None, rerun: Path | None) -> None:
    """Refuse a folder as a file name before anything is computed."""
    for option, target in (("--json", json_target), ("--picture", picture), ("--rerun", rerun)):
        refuse_folder(None if target is None else str(target), option)


def draw_pushes(
    analysis: Analysis,
    pushes: Sequence[Push],
    found: Assessment,
    picture: Path | None,
    rerun: Path | None,
    json_target: str | None,
) -> None:
    """The collapse mechanism of the weakest push; without pushes, the contact interface graph."""
    results = found.results if found.stable else ()
    if picture is not None:
        from poise.viewing import graph_panel, mechanism_panel, write_picture

        if results:
            weakest = min(range(len(results)), key=lambda row: results[row].robustness)
            panel = mechanism_panel(analysis, pushes[weakest], results[weakest])
        else:
            panel = graph_panel(analysis)
        _print_written(write_picture([panel], picture), json_target)
    if rerun is not None:
        from poise.viewing import write_assembly_recording

        shown = pushes if results else ()
        _print_written(write_assembly_recording(rerun, analysis, shown, results), json_target)


def draw_map(found: RobustnessMap, picture: Path | None, rerun: Path | None, json_target: str | None) -> None:
    """The coloured surface."""
    if picture is not None:
        from poise.viewing import map_panel, write_picture

        _print_written(write_picture([map_panel(found)], picture), json_target)
    if rerun is not None:
        from poise.viewing import write_assembly_recording

        _print_written(write_assembly_recording(rerun, found.analysis, found_map=found), json_target)


def draw_limits(
    analysis: Analysis,
    found: AccelerationLimits,
    picture: Path | None,
    rerun: Path | None,
    json_target: str | None,
) -> None:
    """The polar plot of the acceleration limits."""
    if picture is not None:
        from poise.viewing import limits_panel, write_picture

        _print_written(write_picture([limits_panel(found)], picture), json_target)
    if rerun is not None:
        from poise.viewing import write_assembly_recording

        _print_written(write_assembly_recording(rerun, analysis, limits=found), json_target)


def _print_written(written: Path, json_target: str | None) -> None:
    console(json_target).print(f"written: {written}", soft_wrap=True, markup=False)
