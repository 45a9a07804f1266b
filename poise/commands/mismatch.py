"""`poise mismatch`: the physics that a recording shows and the simulation lacks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from poise.commands.mismatch_against import examined_against, print_against
from poise.commands.mismatch_answer import (
    UNEXAMINED,
    as_json,
    print_answer,
    print_recordings,
    print_written,
    unexamined_json,
    write_report,
)
from poise.commands.mismatch_design import design_json, design_sentence, designed, write_design
from poise.commands.mismatch_drives import drives_json, print_drives
from poise.commands.mismatch_export import (
    ExportModelOption,
    IntoOption,
    ModelExport,
    PayloadLinkOption,
    PreparedExports,
    prepared_exports,
    read_model_exports,
    with_payload_link,
)
from poise.commands.output import (
    BAG_HELP,
    JsonOption,
    SearchDeadlineOption,
    console,
    progress_bar,
    refuse_folder,
    warn,
    write_json,
)
from poise.errors import ErrorCode, InputError
from poise.files import write_whole
from poise.memory import keep_freed_memory
from poise.mismatch.answer import Diagnosis, DiscriminatingMotion, diagnose
from poise.mismatch.application import found_drives
from poise.mismatch.comparing import Comparison
from poise.mismatch.reading import (
    NominalModel,
    ReadRecording,
    dump_model,
    joined,
    load_model,
    read_joint_names,
    read_recording,
    spans,
)
from poise.recording import open_recording
from poise.simulation.rollout import DriveEstimate

_ModelOption = Annotated[
    Path | None,
    typer.Option(
        "--model",
        metavar="FILE",
        help="model.yaml: payload, tolerances, noise (default: the payload is identified from the recording).",
        show_default=False,
    ),
]


BagsArgument = Annotated[
    list[Path],
    typer.Argument(metavar="BAG...", help=f"{BAG_HELP} With several, the last is held out.", show_default=False),
]
_ReportOption = Annotated[
    Path | None,
    typer.Option("--report", metavar="DIR", help="Write an HTML report and a Rerun scene.", show_default=False),
]
SaveOption = Annotated[
    Path | None,
    typer.Option("--save", metavar="FILE", help="Write the model with the effects found.", show_default=False),
]
SeparateOption = Annotated[
    Path | None,
    typer.Option(
        "--separate",
        metavar="FILE",
        help="Design a motion that separates the effects that remain indistinguishable, and write it (YAML).",
        show_default=False,
    ),
]


AgainstOption = Annotated[
    Path | None,
    typer.Option(
        "--against",
        metavar="SIM",
        help="Recording of a simulator: it is the nominal prediction. Without a model, differences are located.",
        show_default=False,
    ),
]
SceneOption = Annotated[
    Path | None,
    typer.Option(
        "--scene",
        metavar="SCENE",
        help="Scene file of objects on a base that moves; tf has their poses. Says why they slipped or tipped.",
        show_default=False,
    ),
]
CarrierOption = Annotated[
    str,
    typer.Option(
        "--carrier",
        metavar="FRAME",
        help="With --scene: frame of the base (default: a fixed object of the scene).",
        show_default=False,
    ),
]
CarriedPictureOption = Annotated[
    Path | None,
    typer.Option("--picture", metavar="PNG", help="With --scene: draw load and motion over time.", show_default=False),
]
AgainstJointsOption = Annotated[
    str | None,
    typer.Option(
        "--joints",
        metavar="SIM=BAG,...",
        help="With --against: joints that the simulator calls otherwise, with the names of the recording.",
        show_default=False,
    ),
]


def mismatch(
    bags: BagsArgument,
    model: _ModelOption = None,
    report: _ReportOption = None,
    save: SaveOption = None,
    separate: SeparateOption = None,
    against: AgainstOption = None,
    joints: AgainstJointsOption = None,
    scene: SceneOption = None,
    carrier: CarrierOption = "",
    picture: CarriedPictureOption = None,
    export: ExportModelOption = None,
    into: IntoOption = None,
    payload_link: PayloadLinkOption = None,
    deadline: SearchDeadlineOption = math.inf,
    json_target: JsonOption = None,
) -> None:
    """Identify the physical effects that a recording shows and the simulation lacks.

    The recordings need joint_states, robot_description, and the wrench, joint efforts, or both (or the wrench and tf up
    to the sensor); odom and joint commands are used if present. The effects of a library compete by evidence; small
    calibration errors are always fitted. When no effect fits, the answer is `unknown`, with the state that the residual
    depends on. With --against, the recording of a simulator takes the place of the simulation. With --scene, the
    recording shows objects on a base that moves.

    Example:  poise mismatch run.mcap --model model.yaml --json answer.json --report out --save augmented.yaml
    """
    refuse_folder(json_target, "--json")
    keep_freed_memory()
    if scene is not None:
        _scene_alone(bags, (model, report, save, separate, against, joints, export, into, payload_link))
        from poise.commands.mismatch_scene import answer_scene  # it loads the assembly engine, which takes long

        answer_scene(bags[0], scene, carrier, deadline, picture, json_target)
        return
    exports = read_model_exports(export, into)
    nominal = NominalModel() if model is None else with_payload_link(load_model(model), payload_link)
    asked = _Asked(bags, report, save, separate, exports, payload_link, deadline, json_target)
    if against is not None:
        _against(asked, against, nominal, joints)
        return
    readings = read_with_warnings(bags, nominal)
    recorded, last = joined([reading.recorded for reading in readings])
    if not (recorded.has("wrench") or recorded.has("effort")):
        _answer_without_signal(asked, readings)
        return
    with progress_bar("searching for effects") as progress:
        last_one = last if last.any() else None
        found = diagnose(recorded, readings[0].model, last_one, deadline=deadline, progress=progress)
    _answer(asked, readings, found)


def _scene_alone(bags: Sequence[Path], others: Sequence[object]) -> None:
    if len(bags) > 1 or any(other is not None for other in others):
        sentence = "--scene takes one recording, and no options but --carrier, --picture, --deadline and --json"
        raise InputError(ErrorCode.BAD_INPUT, sentence)


@dataclass(frozen=True)
class _Asked:
    """What the command line asks for; see the options of `mismatch`."""

    bags: list[Path]
    report: Path | None
    save: Path | None
    separate: Path | None
    exports: list[ModelExport]
    payload_link: str | None
    deadline: float
    json_target: str | None


def _answer(asked: _Asked, readings: list[ReadRecording], found: Diagnosis) -> None:
    """The answer about recordings, and the files that were asked for."""
    bags, separate = asked.bags, asked.separate
    drives = _drives(bags[0], readings[0])
    planned = prepared_exports(asked.exports, found, drives, bags[0], readings[0], asked.payload_link)
    design = None if separate is None else designed(found, readings[0].robot)
    remarks = [note for reading in readings for note in reading.notes] + [design_sentence(design)] * bool(separate)
    written = [] if asked.report is None else write_report(asked.report, bags, remarks, found)
    written += _write_yaml(found, design, separate, asked.save)
    times = spans([reading.recorded for reading in readings])
    recordings = [{"bag": str(bag), "start": a, "end": b} for bag, (a, b) in zip(bags, times, strict=True)]
    more = {"recordings": recordings, "designed_motion": design_json(design, separate)}
    write_json(asked.json_target, as_json(found, readings) | more | drives_json(drives, planned))
    people = console(asked.json_target)
    print_answer(people, found)
    print_drives(people, drives)
    if separate is not None:
        people.print(design_sentence(design), soft_wrap=True)
    print_recordings(people, found, recordings)
    print_written(people, [*written, *planned.write()])


def _answer_without_signal(asked: _Asked, readings: list[ReadRecording]) -> None:
    """The answer about recordings without a usable wrench or effort: findings, and the drives."""
    drives = _drives(asked.bags[0], readings[0])
    planned = prepared_exports(asked.exports, None, drives, asked.bags[0], readings[0], asked.payload_link)
    write_json(asked.json_target, unexamined_json(readings) | drives_json(drives, planned))
    people = console(asked.json_target)
    people.print(UNEXAMINED)
    print_drives(people, drives)
    print_written(people, planned.write())


def _against(asked: _Asked, simulated: Path, nominal: NominalModel, joints: str | None) -> None:
    """The answer about a recording and that of a simulator."""
    if len(asked.bags) > 1 or asked.save is not None or asked.separate is not None:
        raise InputError(ErrorCode.BAD_INPUT, "--against takes one recording, without --save and --separate")
    called, bag = read_joint_names(joints), asked.bags[0]
    content, found, readings = examined_against(bag, simulated, nominal, called, asked.deadline)
    written: list[Path] = []
    planned = PreparedExports()
    if isinstance(found, Comparison):
        if asked.report is not None:
            written = write_report(asked.report, [bag, simulated], list(found.notes), found.diagnosis)
        if found.side == "b":
            planned = prepared_exports(asked.exports, found.diagnosis, (), bag, readings[1], asked.payload_link)
        elif asked.exports:
            warn("--export writes nothing: the simulation has more than the recording shows")
    elif asked.exports or asked.report is not None:
        warn("without a model of the robot, differences have no names: --export and --report write nothing")
    write_json(asked.json_target, content | drives_json((), planned))
    people = console(asked.json_target)
    print_against(people, found, content["motion"])
    print_written(people, [*written, *planned.write()])


def _drives(bag: Path, reading: ReadRecording) -> tuple[DriveEstimate, ...]:
    """The drives of a simulator's model, fitted to the commands of the first recording."""
    with progress_bar("fitting drives") as progress:
        return found_drives(open_recording(bag), reading, progress)


def read_with_warnings(bags: list[Path], nominal: NominalModel) -> list[ReadRecording]:
    """As `read_all`; what is remarkable about a recording is a warning."""
    readings = read_all(bags, nominal)
    for reading, bag in zip(readings, bags, strict=True):
        for note in reading.notes:
            warn(f"{bag}: {note}")
    return readings


def _write_yaml(
    found: Diagnosis, design: DiscriminatingMotion | None, separate: Path | None, save: Path | None
) -> list[Path]:
    written = []
    if separate is not None and design is not None:
        written.append(write_design(separate, design))
    if save is not None:
        written.append(write_whole(save, dump_model(found.augmented).encode()))
    return written


def read_all(bags: list[Path], nominal: NominalModel) -> list[ReadRecording]:
    """Every recording, read with the payload of the model or, without one, of the first recording.

    Raises:
        InputError: as `read_recording`.
    """
    first = read_recording(open_recording(bags[0]), nominal)
    return [first, *(read_recording(open_recording(bag), first.model) for bag in bags[1:])]
