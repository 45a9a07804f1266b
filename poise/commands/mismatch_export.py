"""`poise mismatch --export KIND:FILE`: what was found, written into the user's own model."""

import os
import stat
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from poise.commands.exports import fixed_pose
from poise.commands.output import refuse_folder, warn
from poise.errors import ErrorCode, InputError, PoiseError
from poise.exporting.models import (
    DriveChange,
    JointChange,
    LinkLoad,
    ModelChanges,
    SensorChange,
    WrittenModel,
    all_model_exporters,
    model_exporter_of,
)
from poise.files import write_whole
from poise.inertia import InertialParameters
from poise.mismatch.answer import Diagnosis
from poise.mismatch.application import (
    UnsureValue,
    found_payload,
    found_sensor,
    joint_values,
    recorded_run,
    unsure_values,
    without_place,
    worsening,
)
from poise.mismatch.reading import NominalModel, ReadRecording, nominal_description
from poise.recording import Recording, open_recording
from poise.simulation.rollout import DriveEstimate

_WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH
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
            overwritten; FILE_UNREADABLE; FILE_UNWRITABLE for a target that is read-only.
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
        _check_writable(text, Path(name))
        found.append(ModelExport(kind, Path(name), source))
    if sources:
        raise InputError(ErrorCode.BAD_INPUT, f"--into {sources[0]} has no --export: give --export KIND:FILE too")
    return found


def _check_writable(asked: str, target: Path) -> None:
    """Refuse a target that is read-only: renaming a file onto it would replace it all the same."""
    if target.exists() and not target.stat().st_mode & _WRITABLE:
        raise InputError(ErrorCode.FILE_UNWRITABLE, f"--export {asked}: the file is read-only: name another one")
    folder = next((each for each in target.absolute().parents if each.exists()), target)
    if not os.access(folder, os.W_OK):
        raise InputError(ErrorCode.FILE_UNWRITABLE, f"--export {asked}: nothing can be written in {folder}")


def with_payload_link(model: NominalModel, payload_link: str | None) -> NominalModel:
    """The nominal model of a simulator, of which a link that the command line names is the payload."""
    if payload_link is None or model.simulator is None or model.payload_link is not None or model.phi is not None:
        return model
    return replace(model, payload_link=payload_link.partition("=")[0])


@dataclass(frozen=True)
class PreparedExports:
    """What `--export` will write; or why nothing can be written.

    Args:
        files: target, content and what is not in it.
        kinds: of the files.
        unsure: values that the recording shows badly.
        error: that ends the command after the answer is printed.
    """

    files: tuple[tuple[Path, WrittenModel], ...] = ()
    kinds: tuple[str, ...] = ()
    unsure: tuple[UnsureValue, ...] = ()
    error: PoiseError | None = None

    def as_json(self) -> list[dict[str, object]]:
        """For the answer."""
        unsure = [each.as_json() for each in self.unsure]
        return [
            {"kind": kind, "file": str(target), "not_written": list(made.left_out), "unsure": unsure}
            for kind, (target, made) in zip(self.kinds, self.files, strict=True)
        ]

    def write(self) -> list[Path]:
        """Write every file, or none.

        Raises:
            PoiseError: see `error`; FILE_UNWRITABLE.
        """
        if self.error is not None:
            raise self.error
        for clause in dict.fromkeys(clause for _, made in self.files for clause in made.left_out):
            warn(f"--export does not write {clause}")
        for each in self.unsure:
            warn(f"--export writes an unsure value: {each.clause}")
        return [write_whole(target, made.content) for target, made in self.files]


def prepared_exports(
    requests: Sequence[ModelExport],
    found: Diagnosis | None,
    drives: Sequence[DriveEstimate],
    bag: Path,
    reading: ReadRecording,
    payload_link: str | None,
) -> PreparedExports:
    """Every request with what was found, before anything is written."""
    if not requests:
        return PreparedExports()
    try:
        recording = open_recording(bag)
        changes = _changes(found, drives, recording, reading, payload_link)
        unsure = () if found is None else unsure_values(found, joint_values(found))
        changes = replace(changes, unsure=tuple(each.clause for each in unsure))
        made = [_written(each, changes, recording, reading.model) for each in requests]
    except PoiseError as error:
        return PreparedExports(error=error)
    targets = [each.target for each in requests]
    return PreparedExports(tuple(zip(targets, made, strict=True)), tuple(each.kind for each in requests), unsure)


def _written(request: ModelExport, changes: ModelChanges, recording: Recording, nominal: NominalModel) -> WrittenModel:
    """The file; of a MuJoCo model without what makes its free runs worse."""
    exporter, source = model_exporter_of(request.kind), _source(request, recording, nominal)
    made = exporter.changed(changes, source)
    if request.kind != "mjcf" or request.source is None:
        return made
    try:
        run = recorded_run(recording)
    except PoiseError:  # too short for a free run
        return made
    folder = request.target.absolute().parent
    lost = worsening(
        run,
        request.source,
        changes.kinds,
        lambda kinds: exporter.changed(changes.without(kinds), source).content,
        folder if folder.is_dir() else Path(tempfile.gettempdir()),
    )
    return exporter.changed(changes.without(lost.kinds, lost.reason), source) if lost.kinds else made


def _source(request: ModelExport, recording: Recording, nominal: NominalModel) -> bytes:
    if not model_exporter_of(request.kind).needs_source:
        return b""
    if request.source is None:
        return nominal_description(nominal, recording.robot_description).encode()
    try:
        return request.source.read_bytes()
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"--into {request.source}: {error.strerror}") from error


def _changes(
    found: Diagnosis | None,
    drives: Sequence[DriveEstimate],
    recording: Recording,
    reading: ReadRecording,
    payload_link: str | None,
) -> ModelChanges:
    fitted = {each.joint: {name: value.value for name, value in each.values.items()} for each in drives if each.kept}
    moved = {
        joint: DriveChange(values.get("gain"), values.get("rate_gain"), values.get("delay"))
        for joint, values in fitted.items()
    }
    of_joints: dict[str, dict[str, float]] = {
        joint: {name: values[name] for name in ("friction", "damping", "armature") if name in values}
        for joint, values in fitted.items()
    }
    reason = "its fit does not predict other windows better"
    worse = [f"the drive of {each.joint}: {reason}" for each in drives if not each.kept]
    if found is None:
        joints = {joint: JointChange(**values) for joint, values in of_joints.items()}
        return ModelChanges(joints, None, tuple(worse), moved)
    for joint, values in joint_values(found).items():
        of_joints[joint] = of_joints.get(joint, {}) | values
    joints = {joint: JointChange(**values) for joint, values in of_joints.items()}
    left_out, payload = [*without_place(found), *worse], found_payload(found)
    frame = reading.model.sensor_frame or ""
    shown = found_sensor(found)
    sensor = SensorChange(frame, **shown) if shown else None
    if payload is not None and payload_link is None:
        left_out.append("the payload: name its link with --payload-link")
    load = None if payload is None or payload_link is None else _load(payload, payload_link, frame, recording, reading)
    return ModelChanges(joints, load, tuple(left_out), moved, sensor)


def _load(
    payload: InertialParameters, payload_link: str, sensor: str, recording: Recording, reading: ReadRecording
) -> LinkLoad:
    link, _, frame = payload_link.partition("=")
    description = nominal_description(reading.model, recording.robot_description)
    pose = fixed_pose(f"--payload-link {payload_link}", frame or link, sensor, recording, description)
    return LinkLoad(link, payload.in_frame(pose.rotation, pose.translation))
