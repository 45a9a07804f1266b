"""`poise calibrate`: where the camera sits on the hand, and the zero offsets of the joints, from views of a board."""

from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import yaml
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from poise.calibration import (
    Board,
    HandEyeCalibration,
    HandEyeOptions,
    calibration_content,
    corrected_description,
    recorded_views,
)
from poise.calibration import (
    calibrate as calibrate_views,
)
from poise.commands.output import BAG_HELP, JsonOption, console, progress_bar, refuse_folders, to_json, warn, write_json
from poise.errors import ErrorCode, InputError
from poise.files import sha256_of, write_whole
from poise.recording import open_recording
from poise.robot import find_urdf, read_urdf

_BagArgument = Annotated[Path | None, typer.Argument(metavar="BAG", help=BAG_HELP, show_default=False)]
SquaresOption = Annotated[str, typer.Option("--squares", metavar="COLUMNSxROWS", help="Squares of the board.")]
SquareOption = Annotated[float, typer.Option("--square", help="Side of a square, m: measure the print.")]
MarkerOption = Annotated[float, typer.Option("--marker", help="Side of a marker, m.")]
DictionaryOption = Annotated[str, typer.Option("--dictionary", help="Of the markers, as OpenCV names it.")]
LinkOption = Annotated[
    str,
    typer.Option("--link", help="The link that carries the camera (default: by tf_static).", show_default=False),
]
_UrdfOption = Annotated[
    str | None,
    typer.Option(
        "--urdf", metavar="FILE", help="The robot (default: robot_description in the bag).", show_default=False
    ),
]
_TopicOption = Annotated[
    str, typer.Option("--topic", help="Of the images (default: the one with colours).", show_default=False)
]
OffsetsOption = Annotated[bool, typer.Option("--offsets/--no-offsets", help="Estimate zero offsets of the joints.")]
_DelayOption = Annotated[bool, typer.Option("--delay/--no-delay", help="Estimate the delay of the images' stamps.")]
_OutOption = Annotated[Path | None, typer.Option("--out", metavar="YAML", help="Write the answer.", show_default=False)]
UrdfOutOption = Annotated[
    Path | None,
    typer.Option("--urdf-out", metavar="FILE", help="Write the robot with the offsets in it.", show_default=False),
]
DrawOption = Annotated[
    Path | None,
    typer.Option("--draw-board", metavar="PNG", help="Write the board to print, and end.", show_default=False),
]


def calibrate(
    bag: _BagArgument = None,
    squares: SquaresOption = "8x6",
    square: SquareOption = 0.03,
    marker: MarkerOption = 0.022,
    dictionary: DictionaryOption = "4X4_50",
    link: LinkOption = "",
    urdf: _UrdfOption = None,
    topic: _TopicOption = "",
    offsets: OffsetsOption = True,
    delay: _DelayOption = True,
    out: _OutOption = None,
    urdf_out: UrdfOutOption = None,
    draw_board: DrawOption = None,
    json_target: JsonOption = None,
) -> None:
    """Estimate where a camera sits on the hand, and the zero offsets of the joints.

    1. Print a ChArUco board (`--draw-board board.png`), glue it to something flat, measure a square, and fasten it on
    the table. 2. Record images, camera_info, joint_states, robot_description and tf_static while the arm brings the
    camera to 15 to 30 places 0.3 to 0.6 m from the board, **turned about all axes by 20 degrees or more**, at rest at
    each; vary all joints. 3. Run this, and give calibration.yaml to `object_scanner` (parameter `calibration`).

    Each number has a standard deviation; what the views do not show is listed, and not estimated. There is no answer
    when the board slipped, has another size, or the views disagree.

    Example:  poise calibrate views.mcap --squares 8x6 --square 0.0302 --out calibration.yaml
    """
    refuse_folders({"--out": out, "--urdf-out": urdf_out, "--draw-board": draw_board, "--json": json_target})
    board = Board(*_size(squares), square, marker, dictionary)
    people = console(json_target)
    if draw_board is not None:
        people.print(f"written: {escape(str(write_whole(draw_board, board.picture())))}", soft_wrap=True)
        return
    if bag is None:
        raise InputError(ErrorCode.BAD_INPUT, "calibrate: give a recording, or --draw-board PNG; see --help")
    description = None if urdf is None else read_urdf(find_urdf(urdf))
    found, content, text = _work(bag, board, (link, description, topic), HandEyeOptions(offsets, delay))
    written = [] if out is None else [write_whole(out, yaml.safe_dump(content, sort_keys=False).encode())]
    if urdf_out is not None:
        given = {name: each["offset"] for name, each in content["joint_offsets"].items()}
        written.append(write_whole(urdf_out, corrected_description(text, given).encode()))
    write_json(json_target, content)
    _say(people, found)
    for path in written:
        people.print(f"written: {escape(str(path))}", soft_wrap=True)


def _work(
    bag: Path, board: Board, where: tuple[str, str | None, str], options: HandEyeOptions
) -> tuple[HandEyeCalibration, dict[str, Any], str]:
    """The calibration, the content of its file, and the robot description that it holds for."""
    recording = open_recording(bag)
    for loss in recording.losses:
        warn(loss.sentence)
    with progress_bar("looking for the board") as reach:
        views = recorded_views(recording, board.detector(), *where, reach)
    found = calibrate_views(views.kinematics, views.kinematics.link, views.camera, views.sightings, options)
    provenance = {
        "recording": str(bag),
        "sha256": sha256_of(bag) or None,
        "images": views.images,
        "board": f"{board.columns}x{board.rows} squares of {board.square:g} m, {board.dictionary}",
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "poise": version("poise"),
    }
    text = recording.robot_description() if where[1] is None else where[1]
    return found, to_json(calibration_content(found, views.frame, provenance)), text


def _say(people: Console, found: HandEyeCalibration) -> None:
    sigma, x = np.sqrt(np.diag(found.covariance)), found.parameters
    people.print(
        f"{found.views} views ({len(found.rejected)} outliers); corners {found.rms:.2f} pixels rms, noise"
        f" {found.noise:.2f}; views have the board {1e3 * found.disagreement:.2f} mm from each other"
    )
    table = Table("", "estimate", "sigma", "unit")
    for k, axis in enumerate("xyz"):
        row = 1e3 * x.eye.translation[k], 1e3 * sigma[3 + k]
        table.add_row(f"camera in {found.link}, {axis}", f"{row[0]:.2f}", f"{row[1]:.2f}", "mm")
    quaternion = ", ".join(f"{value:.5f}" for value in x.eye.vector[3:])
    turn = 180 / np.pi * float(np.linalg.norm(sigma[:3]))
    table.add_row("turned by x y z w", quaternion, f"{turn:.3f}", "deg")
    joints = len(found.joint_names)
    for k, name in enumerate(found.joint_names):
        if found.identified[k]:
            row = np.degrees(x.offsets[k]), np.degrees(sigma[12 + k])
            table.add_row(f"offset of {name}", f"{row[0]:.3f}", f"{row[1]:.3f}", "deg")
    if found.delay_identified:
        table.add_row("images are late by", f"{1e3 * x.delay:.1f}", f"{1e3 * sigma[12 + joints]:.1f}", "ms")
    people.print(table)
    for name, reason in found.reasons.items():
        people.print(f"not identified: {escape(name)}: {escape(reason)}")
    for note in found.notes:
        people.print(f"note: {escape(note)}")


def _size(text: str) -> tuple[int, int]:
    words = text.lower().split("x")
    if len(words) != 2 or not all(word.isdigit() for word in words):
        raise InputError(ErrorCode.BAD_INPUT, f"--squares '{text}': give COLUMNSxROWS, as 8x6")
    return int(words[0]), int(words[1])
