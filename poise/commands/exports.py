"""`--export KIND[:FILE]`: an identified payload in the formats of simulators, planners and robot controllers."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

from poise.commands.output import STDOUT, refuse_folder, warn
from poise.errors import ErrorCode, InputError
from poise.exporting import all_exporters, export, exporter_of
from poise.files import write_whole
from poise.geometry import Pose
from poise.inertia import InertialEstimate

ExportOption = Annotated[
    list[str] | None,
    typer.Option(
        "--export",
        metavar="KIND[:FILE]",
        help="Write the payload in another format, to a file or to stdout; may be given several times. "
        + "; ".join(f"{exporter.kind}: {exporter.summary}" for exporter in all_exporters())
        + ".",
        show_default=False,
    ),
]
FlangePoseOption = Annotated[
    str | None,
    typer.Option(
        "--flange-pose",
        metavar="'X Y Z QX QY QZ QW'",
        help="Pose of the sensor frame in the robot's flange frame, m and a quaternion, for the formats that take"
        f" values there ({', '.join(each.kind for each in all_exporters() if each.flange)}). Default: both coincide.",
        show_default=False,
    ),
]


class ExportRequest(NamedTuple):
    """One `--export`: what, and where to; None is stdout."""

    kind: str
    target: Path | None


def read_exports(texts: Sequence[str] | None, json_target: str | None) -> tuple[ExportRequest, ...]:
    """The requests of the command line, checked before anything is computed.

    Raises:
        InputError: BAD_INPUT for an unknown kind, for a folder as file, or when stdout carries the JSON already.
    """
    requests = []
    for text in texts or ():
        kind, _, name = text.partition(":")
        exporter_of(kind)
        refuse_folder(name or None, "--export")
        requests.append(ExportRequest(kind, Path(name) if name else None))
    if json_target == STDOUT and any(request.target is None for request in requests):
        raise InputError(ErrorCode.BAD_INPUT, "--json - and --export without a file both write to stdout: name a file")
    return tuple(requests)


def read_pose(text: str | None, option: str) -> Pose | None:
    """A pose of seven numbers, None for none.

    Raises:
        InputError: BAD_INPUT.
    """
    if text is None:
        return None
    try:
        numbers = np.array([float(word) for word in text.replace(",", " ").split()])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (7,) or not np.isfinite(numbers).all() or not numbers[3:].any():
        raise InputError(ErrorCode.BAD_INPUT, f"{option} {text!r}: give seven numbers, x y z qx qy qz qw")
    return Pose.from_vector(numbers)


def write_exports(
    requests: Sequence[ExportRequest], estimate: InertialEstimate, flange_from_sensor: Pose | None
) -> list[Path]:
    """Write every request, or nothing when one of them cannot be expressed; return the files.

    Raises:
        NoAnswerError: NOT_IDENTIFIABLE, NOT_CONSISTENT. InputError: FILE_UNWRITABLE.
    """
    texts = [export(estimate, request.kind, flange_from_sensor) for request in requests]
    written = []
    for request, text in zip(requests, texts, strict=True):
        omitted = exporter_of(request.kind).omits
        if omitted:
            warn(f"{request.kind} cannot express {', '.join(omitted)}")
        if request.target is None:
            sys.stdout.write(text)
        else:
            written.append(write_whole(request.target, text.encode()))
    return written
