"""`poise mismatch --export KIND:FILE`: what was found, written into the user's own model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from poise.commands.exports import fixed_pose
from poise.commands.output import refuse_folder, warn
from poise.errors import ErrorCode, InputError
from poise.exporting.models import JointChange, LinkLoad, ModelChanges, all_model_exporters, model_exporter_of
from poise.files import write_whole
from poise.mismatch.answer import Diagnosis
from poise.mismatch.application import found_payload, joint_values, without_place
from poise.mismatch.reading import NominalModel, nominal_description
from poise.recording import Recording, open_recording

ExportModelOption = Annotated[
    list[str] | None,
    typer.Option(
        "--export",
        metavar="KIND:FILE",
        help="Write the model --into with what was found; may be given several times. "
        + "; ".join(f"{exporter.kind}: {exporter.summary}" for exporter in all_model_exporters())
        + ".",
        show_default=False,
    ),
]
IntoOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--into",
        metavar="MODEL",
        help="Model file to change (.xml, .urdf, .sdf), one for each --export in their order, but for json; it is read,"
        " not written. Default for urdf: the recording's robot description.",
        show_default=False,
    ),
]
PayloadLinkOption = Annotated[
    str | None,
    typer.Option(
        "--payload-link",
        metavar="LINK[=FRAME]",
        help="Link or body of the model that is the payload alone, and the frame of the recording at its origin"
        " (default: of the same name). Without it the payload is not written.",
        show_default=False,
    ),
]


@dataclass(frozen=True)
class ModelExport:
    """One `--export`: what, where to, and the model to change; None: the recording's robot description, or none."""

    kind: str
    target: Path
    source: Path | None


def read_model_exports(texts: Sequence[str] | None, into: Sequence[Path] | None) -> list[ModelExport]:
    """What the command line asks for, checked before anything is computed.

    Raises:
        InputError: BAD_INPUT for an unknown kind, for no file, for a model that is missing, left over, or would be
            overwritten; FILE_UNREADABLE.
    """
    sources = list(into or ())
    found = []
    for text in texts or ():
        kind, _, name = text.partition(":")
        exporter = model_exporter_of(kind)
        refuse_folder(name or None, "--export")
        if not name:
            raise InputError(ErrorCode.BAD_INPUT, f"--export {text}: give KIND:FILE")
        source = sources.pop(0) if exporter.needs_source and sources else None
        if exporter.needs_source and source is None and kind != "urdf":
            raise InputError(ErrorCode.BAD_INPUT, f"--export {text} changes a model of yours: give it with --into")
        if source is not None and not source.is_file():
            raise InputError(ErrorCode.FILE_UNREADABLE, f"--into {source}: no such file")
        if source is not None and Path(name).resolve() == source.resolve():
            raise InputError(ErrorCode.BAD_INPUT, f"--export {text} would overwrite --into: name another file")
        found.append(ModelExport(kind, Path(name), source))
    if sources:
        raise InputError(ErrorCode.BAD_INPUT, f"--into {sources[0]} has no --export: give --export KIND:FILE too")
    return found


def with_payload_link(model: NominalModel, payload_link: str | None) -> NominalModel:
    """The nominal model of a simulator, of which a link that the command line names is the payload."""
    if payload_link is None or model.simulator is None or model.payload_link is not None or model.phi is not None:
        return model
    return replace(model, payload_link=payload_link.partition("=")[0])


def write_model_exports(
    requests: Sequence[ModelExport], found: Diagnosis, bag: Path, nominal: NominalModel, payload_link: str | None
) -> list[Path]:
    """Write every request, or nothing when one of them cannot be; return the files.

    Raises:
        PoiseError: as `ModelExporter.changed` and `found_payload`; FRAME_UNKNOWN; FILE_UNREADABLE, FILE_UNWRITABLE.
    """
    if not requests:
        return []
    recording = open_recording(bag)
    changes = _changes(found, recording, nominal, payload_link)
    texts = [model_exporter_of(each.kind).changed(changes, _source(each, recording, nominal)) for each in requests]
    for clause in changes.left_out:
        warn(f"--export does not write {clause}")
    return [write_whole(request.target, text) for request, text in zip(requests, texts, strict=True)]


def _source(request: ModelExport, recording: Recording, nominal: NominalModel) -> bytes:
    if not model_exporter_of(request.kind).needs_source:
        return b""
    if request.source is None:
        return nominal_description(nominal, recording.robot_description).encode()
    try:
        return request.source.read_bytes()
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"--into {request.source}: {error.strerror}") from error


def _changes(found: Diagnosis, recording: Recording, nominal: NominalModel, payload_link: str | None) -> ModelChanges:
    joints = {joint: JointChange(**values) for joint, values in joint_values(found).items()}
    left_out, payload = without_place(found), found_payload(found)
    if payload is not None and payload_link is None:
        left_out.append("the payload: name its link with --payload-link")
    if payload is None or payload_link is None:
        return ModelChanges(joints, None, tuple(left_out))
    link, _, frame = payload_link.partition("=")
    sensor = found.main.problem.model.sensor_frame or ""
    description = nominal_description(nominal, recording.robot_description)
    pose = fixed_pose(f"--payload-link {payload_link}", frame or link, sensor, recording, description)
    return ModelChanges(joints, LinkLoad(link, payload.in_frame(pose.rotation, pose.translation)), tuple(left_out))
