"""`poise scan`: the cloud of one object, and its parts, from a recorded sweep of a camera on a hand."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, get_args

import typer
from rich.markup import escape

from poise.commands.output import BAG_HELP, JsonOption, console, progress_bar, refuse_folders, warn, write_json
from poise.commands.segment import ColourOption, NumberOption, segmentation_options, shades, write_picture
from poise.errors import ErrorCode, InputError
from poise.files import write_whole
from poise.recording import open_recording
from poise.robot import Mounting, find_urdf, read_urdf
from poise.scanning import (
    MOST_FRAMES,
    PoseSource,
    Scan,
    ScanOptions,
    Sweep,
    SweepOptions,
    read_sweep,
    scan_ply,
    scan_sweep,
)
from poise.shape import Segmentation, SegmentationOptions, labelled_ply, surface_ply

_BagArgument = Annotated[Path, typer.Argument(metavar="BAG", help=BAG_HELP)]
CloudOption = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="PLY", help="Write the cloud with colours, normals and the field seen.", show_default=False
    ),
]
PartsOption = Annotated[
    Path | None,
    typer.Option("--parts", metavar="PLY", help="Write the points with their parts as colours.", show_default=False),
]
SurfaceOption = Annotated[
    Path | None,
    typer.Option("--surface", metavar="PLY", help="Write the closed surface with its parts.", show_default=False),
]
_PictureOption = Annotated[
    Path | None, typer.Option("--picture", metavar="PNG", help="Draw the parts.", show_default=False)
]
NearOption = Annotated[
    str | None,
    typer.Option(
        "--near",
        metavar="'X Y Z'",
        help="Point in the robot's base frame, m: of several objects, the one nearest to it is scanned (default: the"
        " one in the middle of the views).",
        show_default=False,
    ),
]
HandEyeOption = Annotated[
    str | None,
    typer.Option(
        "--hand-eye",
        metavar="'LINK X Y Z QX QY QZ QW'",
        help="Pose of the camera's optical frame in a link of the robot, m and a quaternion (default: from"
        " robot_description or tf_static).",
        show_default=False,
    ),
]
_UrdfOption = Annotated[
    str | None,
    typer.Option(
        "--urdf", metavar="FILE", help="The robot (default: robot_description in the bag).", show_default=False
    ),
]
FramesOption = Annotated[int, typer.Option("--frames", min=1, max=600, help="Largest number of frames.")]
VoxelOption = Annotated[float, typer.Option("--voxel", min=2e-4, max=0.05, help="Spacing of the points, m.")]
UnitOption = Annotated[
    float | None,
    typer.Option(
        "--depth-unit",
        min=1e-6,
        max=1.0,
        help="Unit of integer depth, m (default: millimetres, or the one in which the views show a table).",
        show_default=False,
    ),
]
_RegionOption = Annotated[
    str | None,
    typer.Option(
        "--region",
        metavar="'X Y Z SX SY SZ'",
        help="Middle of the bottom and size of a box in the robot's base frame, m: only what is in it is scanned.",
        show_default=False,
    ),
]
_PosesOption = Annotated[str, typer.Option("--poses", metavar="auto|joints|tf", help="What says where the camera was.")]
_BaseFrameOption = Annotated[
    str,
    typer.Option(
        "--base-frame",
        help="For poses by tf: frame of the answer, z up (default: the topmost); a turntable's if the camera rests.",
        show_default=False,
    ),
]
DelayOption = Annotated[float, typer.Option("--delay", help="Delay of the images' stamps, s.")]
TopicOption = Annotated[
    str, typer.Option("--depth-topic", help="Depth image or PointCloud2 (default: found by type).", show_default=False)
]


def scan(
    bag: _BagArgument,
    out: CloudOption = None,
    parts: PartsOption = None,
    surface: SurfaceOption = None,
    picture: _PictureOption = None,
    near: NearOption = None,
    hand_eye: HandEyeOption = None,
    urdf: _UrdfOption = None,
    frames: FramesOption = MOST_FRAMES,
    voxel: VoxelOption = 1.5e-3,
    depth_unit: UnitOption = None,
    delay: DelayOption = 0.0,
    depth_topic: TopicOption = "",
    region: _RegionOption = None,
    poses: _PosesOption = "auto",
    base_frame: _BaseFrameOption = "",
    number_of_parts: NumberOption = None,
    colour: ColourOption = "on",
    json_target: JsonOption = None,
) -> None:
    """Reconstruct an object on a table from a camera sweep and segment it into parts.

    The bag holds depth images with camera_info (or a PointCloud2), raw or compressed, and colour images if there are
    any; joint_states, robot_description and, for the camera on the hand, tf_static; or the camera's poses as tf. The
    cloud is in the frame of the robot's base.

    Example:  poise scan bags/hammer_sweep.mcap --out hammer.ply --parts parts.ply --picture hammer.png
    """
    refuse_folders({"--out": out, "--parts": parts, "--surface": surface, "--picture": picture, "--json": json_target})
    people = console(json_target)
    description = None if urdf is None else read_urdf(find_urdf(urdf))
    eye, source = _hand_eye(hand_eye), _source_of_poses(poses)
    where = SweepOptions(depth_topic, "", "", description, eye, frames, depth_unit, delay, source, base_frame)
    how = ScanOptions(voxel=voxel, region=_numbers(region, 6, "--region"), near=_numbers(near, 3, "--near"))
    sweep, found, cut, seconds = _work(bag, where, how, segmentation_options(number_of_parts, None), colour)
    write_json(json_target, as_json(bag, sweep, found, cut, seconds))
    written = [
        *([] if out is None else [write_whole(out, scan_ply(found))]),
        *([] if parts is None else [write_whole(parts, labelled_ply(found.points, cut.labels))]),
        *([] if surface is None else [write_whole(surface, surface_ply(cut))]),
        *([] if picture is None else [write_picture(picture, cut, bag.stem)]),
    ]
    volume, spread = cut.solid.volume * 1e6, cut.solid.volume_std * 1e6
    people.print(
        f"{len(sweep.views)} views, {found.seen.sum()} points seen and {(~found.seen).sum()} completed in"
        f" {seconds[0]:.2f} s; {cut.n_parts} parts, {volume:.4g} ± {spread:.2g} cm3 in {seconds[1]:.2f} s"
    )
    for path in written:
        people.print(f"written: {escape(str(path))}", soft_wrap=True)


def _work(
    bag: Path, where: SweepOptions, how: ScanOptions, cutting: SegmentationOptions, colour: str
) -> tuple[Sweep, Scan, Segmentation, tuple[float, float]]:
    """Bag to parts, with a warning for every note; s for the cloud and for the parts."""
    recording = open_recording(bag)
    for loss in recording.losses:
        warn(loss.sentence)
    with progress_bar("reading the frames") as reach:
        sweep = read_sweep(recording, where, reach)
    with progress_bar("joining the views") as reach:
        start = time.perf_counter()
        found = scan_sweep(sweep, how, reach)
        middle = time.perf_counter()
        cut = replace(found, colours=shades(colour, found.colours)).segmented(cutting)
        seconds = middle - start, time.perf_counter() - middle
    for note in (*sweep.notes, *found.notes, *cut.notes):
        warn(note)
    return sweep, found, cut, seconds


def as_json(path: Path, sweep: Sweep, found: Scan, cut: Segmentation, seconds: tuple[float, float]) -> dict[str, Any]:
    """What was found; m and m3, in the frame of the robot's base."""
    return {
        "frame": sweep.base,
        "n_views": found.n_views,
        "n_objects": found.n_objects,
        "n_points": len(found.points),
        "seen": found.seen,
        "labels": cut.labels,
        "n_parts": cut.n_parts,
        "volume": cut.solid.volume,
        "volume_std": cut.solid.volume_std,
        "volume_if_hollow": cut.volume_if_hollow,
        "part_volumes": cut.volumes,
        "part_centroids": cut.centroids,
        "table": {"normal": found.plane.normal, "offset": found.plane.offset, "thickness": found.plane.thickness},
        "poses_moved": found.moved,
        "scan_seconds": seconds[0],
        "seconds": sum(seconds),
        "bag": str(path),
        "notes": [*sweep.notes, *found.notes, *cut.notes],
    }


def _hand_eye(text: str | None) -> Mounting | None:
    if text is None:
        return None
    link, _, rest = text.strip().partition(" ")
    return Mounting.of_vector(link, "camera", _numbers(rest, 7, "--hand-eye"))


def _source_of_poses(word: str) -> PoseSource:
    for source in get_args(PoseSource):
        if word == source:
            return source  # type: ignore[no-any-return]
    raise InputError(ErrorCode.BAD_INPUT, f"--poses '{word}': give one of {', '.join(get_args(PoseSource))}")


def _numbers(text: str | None, count: int, option: str) -> Any:
    if text is None:
        return None
    try:
        values = tuple(float(word) for word in text.replace(",", " ").split())
    except ValueError:
        values = ()
    if len(values) != count:
        raise InputError(ErrorCode.BAD_INPUT, f"{option} '{text}': give {count} numbers, in quotes")
    return values
