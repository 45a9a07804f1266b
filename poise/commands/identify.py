"""`poise identify`: the payload of a recording, as a table, JSON and a report."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from poise.commands.exports import (
    ExportOption,
    FlangePoseOption,
    FrameOption,
    GripperOption,
    TransitionTimeOption,
    read_exports,
    write_exports,
)
from poise.commands.identify_causes import (
    Known,
    RepairOption,
    Weigh,
    findings_json,
    fit_json,
    fit_words,
    no_answer_json,
    weighed_with_causes,
)
from poise.commands.identify_model import compensation_fields, say, without_effects
from poise.commands.identify_segments import segment_table, segments_json
from poise.commands.output import (
    BAG_HELP,
    JsonOption,
    add_scene,
    console,
    progress_bar,
    refuse_folder,
    warn,
    write_json,
)
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.estimators import AUTO, DEFAULT_METHOD, all_estimators
from poise.inertia.model import ObjectShape, load_object
from poise.inertia.pipeline import Identification, InertialEstimate
from poise.inertia.pipeline import identify as identify_recording
from poise.recording import Recording, open_recording
from poise.robot import RobotModel
from poise.viewing import parameter_rows, readable, rounded

MethodOption = Annotated[
    str,
    typer.Option(
        "--method",
        help="; ".join(f"{entry.name}: {entry.summary}" for entry in all_estimators().values())
        + f"; {AUTO}: static or ols, whichever the motion suits. geo, pmd and hps need --object.",
    ),
]
ObjectOption = Annotated[
    Path | None,
    typer.Option(
        "--object",
        metavar="CLOUD_OR_MESH",
        help="Shape of the payload in m, in the sensor frame or placed by --object-pose: a mesh (STL, OBJ, PLY; each"
        " closed body is a part) or points on its surface (PLY, XYZ, CSV, NPY, PCD), which are segmented.",
        show_default=False,
    ),
]
ObjectPoseOption = Annotated[
    str | None,
    typer.Option(
        "--object-pose",
        metavar="'X Y Z QX QY QZ QW'",
        help="Pose of the shape's frame in the sensor frame, m and a unit quaternion.",
        show_default=False,
    ),
]
ObjectScaleOption = Annotated[
    float, typer.Option("--object-scale", help="m per unit of the file: 0.001 for a mesh in millimetres.")
]
ShapeAccuracyOption = Annotated[
    float | None,
    typer.Option(
        "--shape-accuracy",
        help="Relative error, one sigma, of lengths in the shape and of the borders of its parts (default: 0.0007 for a"
        " mesh of several bodies, 0.03 for one body, 0.0075 for points).",
        show_default=False,
    ),
]
SensorFrameOption = Annotated[
    str | None,
    typer.Option("--sensor-frame", help="Frame of the wrench (default: that of its messages).", show_default=False),
]
UrdfOption = Annotated[
    Path | None,
    typer.Option(
        "--urdf",
        help="URDF for the joint states (default: the recording's robot_description; without one tf is used).",
        show_default=False,
    ),
]
GravityOption = Annotated[
    float | None,
    typer.Option("--gravity", help="m/s2 (default: that of the recording, else 9.80665).", show_default=False),
]
WrenchTopicOption = Annotated[str, typer.Option("--wrench-topic", help="Topic of the force-torque sensor.")]
MaxForceOption = Annotated[
    float,
    typer.Option("--max-force", help="Range of the sensor, N; samples that reach it are rejected.", show_default=False),
]
MaxTorqueOption = Annotated[float, typer.Option("--max-torque", help="The same for torque, N m.", show_default=False)]


ReportOption = Annotated[
    Path | None,
    typer.Option("--report", metavar="DIR", help="Write an HTML report and a Rerun scene.", show_default=False),
]


ModelOption = Annotated[
    Path | None,
    typer.Option(
        "--model",
        metavar="FILE",
        help="model.yaml of poise mismatch --save; its effects are first subtracted from the wrench.",
        show_default=False,
    ),
]


BagArgument = Annotated[Path, typer.Argument(metavar="BAG", help=BAG_HELP, show_default=False)]


def identify(
    bag: BagArgument,
    object_file: ObjectOption = None,
    method: MethodOption = DEFAULT_METHOD,
    object_pose: ObjectPoseOption = None,
    object_scale: ObjectScaleOption = 1.0,
    shape_accuracy: ShapeAccuracyOption = None,
    sensor_frame: SensorFrameOption = None,
    urdf: UrdfOption = None,
    gravity: GravityOption = None,
    wrench_topic: WrenchTopicOption = "wrench",
    max_force: MaxForceOption = np.inf,
    max_torque: MaxTorqueOption = np.inf,
    model: ModelOption = None,
    repair: RepairOption = False,
    report: ReportOption = None,
    exports: ExportOption = None,
    frame: FrameOption = None,
    flange_pose: FlangePoseOption = None,
    gripper: GripperOption = None,
    transition_time: TransitionTimeOption = 0.0,
    json_target: JsonOption = None,
) -> None:
    """Estimate mass, centre of mass and inertia of the payload on a force-torque sensor.

    The recording needs the wrench, and one of: joint_states with robot_description; tf up to the sensor; imu with a
    gyroscope. Poses held still in three attitudes or more give mass, centre of mass and the sensor's bias; motion also
    gives the inertia it shows, and the delay of the clocks. Where no payload explains the wrench, the cause is named.

    Example:  poise identify bags/kuka_static_poses.mcap --json payload.json --report out
    """
    refuse_folder(json_target, "--json")
    plan = read_exports(exports, json_target, flange_pose, frame, gripper, transition_time, urdf)
    shape = None if object_file is None else placed_object(object_file, object_scale, object_pose)
    people, known = console(json_target), (sensor_frame, gravity, wrench_topic)
    with without_effects(bag, model, *known) as (source, taken), progress_bar("weighing") as progress:
        more = {"progress": progress, "keep_history": report is not None, **_shape_arguments(shape, shape_accuracy)}
        weigh_it = weigher(urdf, method, known, (max_force, max_torque), more)
        weighed = weighed_with_causes(weigh_it, source, known, repair)
    if weighed.answer is None:
        write_json(json_target, no_answer_json(bag, weighed))
        raise weighed.failure or NoAnswerError(ErrorCode.NOT_IDENTIFIABLE, f"{bag}: there is no estimate")
    content = as_json(bag, weighed.recording, weighed.answer) | compensation_fields(taken)
    content["object"] = None if shape is None else shape.words
    _show(people, bag, weighed.answer, report, content, json_target)
    say(people, taken)
    if weighed.failure is not None:
        raise weighed.failure
    for path in write_exports(plan, weighed.answer.estimate, bag):
        people.print(f"written: {escape(str(path))}", soft_wrap=True)


def _show(
    people: Console,
    bag: Path,
    answer: Identification,
    report: Path | None,
    content: dict[str, Any],
    json_target: str | None,
) -> None:
    """Warnings, the report, the JSON and the table."""
    for warning in content["warnings"]:
        warn(warning)
    written = [] if report is None else write_report(report, bag, answer)
    write_json(json_target, content)
    print_answer(people, bag, answer)
    for path in written:
        people.print(f"written: {escape(str(path))}", soft_wrap=True)


def weigher(
    urdf: Path | None,
    method: str,
    known: Known,
    limits: tuple[float, float],
    more: dict[str, Any],
) -> Weigh:
    """Weighs a recording by the options of the command, `known` being sensor frame, gravity and topic."""
    frame, _, topic = known
    return lambda path, gravity: weigh(path, urdf, method, frame, gravity, topic, limits, **more)


def _shape_arguments(shape: ObjectShape | None, accuracy: float | None) -> dict[str, Any]:
    if shape is None:
        return {}
    return {"parts": shape.parts, "shape_accuracy": shape.accuracy if accuracy is None else accuracy}


def placed_object(path: Path, scale: float, pose: str | None) -> ObjectShape:
    """The shape of --object in the sensor frame.

    Raises:
        InputError: BAD_INPUT for a pose that is none, or as `load_object`.
    """
    shape = load_object(path, scale)
    if pose is None:
        return shape
    try:
        numbers = [float(word) for word in pose.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != 7:
        raise InputError(ErrorCode.BAD_INPUT, f"--object-pose '{pose}': give seven numbers, x y z qx qy qz qw")
    return shape.placed(numbers[:3], numbers[3:])


def weigh(
    bag: Path,
    urdf: Path | None,
    method: str,
    sensor_frame: str | None,
    gravity: float | None,
    wrench_topic: str,
    saturation: tuple[float, float],
    **known: Any,
) -> tuple[Recording, Identification]:
    """Open a recording and identify its payload; `known` goes on to `identify`.

    Raises:
        InputError, NoAnswerError: as `identify` of `poise.inertia`.
    """
    recording = open_recording(bag)
    model = None
    if urdf is not None and (frame := sensor_frame or next(iter(recording.wrench_frames(wrench_topic)))):
        model = RobotModel.from_file(urdf, frame)
    try:
        answer = identify_recording(
            recording,
            robot_model=model,
            sensor_frame=sensor_frame,
            gravity=gravity,
            method=method,
            wrench_topic=wrench_topic,
            saturation=saturation,
            **known,
        )
    except InputError as error:
        if error.code is not ErrorCode.FRAME_UNKNOWN or sensor_frame or "--sensor-frame" in error.message:
            raise
        raise InputError(
            error.code, f"{error.message}; --sensor-frame gives that of the wrench", **error.data
        ) from error
    return recording, answer


def as_json(bag: Path, recording: Recording, answer: Identification) -> dict[str, Any]:
    """The fields of the contract, and what else is known; SI units, stamps in s."""
    estimate = answer.estimate
    parameters = estimate.parameters
    losses = [
        {"kind": str(loss.kind), "sentence": loss.sentence, "messages": loss.messages} for loss in recording.losses
    ]
    read = (*(loss["sentence"] for loss in losses), *recording.clocks.values())
    return {
        "mass": parameters.mass,
        "com": parameters.com,
        "inertia": parameters.inertia_vector,
        "covariance": estimate.covariance,
        "bias": estimate.bias,
        "delay": estimate.delay,
        "method": estimate.method,
        "consistent": estimate.consistent,
        "n_samples": estimate.n_samples,
        "rejected": [
            {"start": span.start * 1e-9, "end": span.end * 1e-9, "reason": span.reason, "samples": span.n_samples}
            for span in estimate.rejected
        ],
        "mass_std": estimate.mass_std,
        "com_std": estimate.com_std,
        "inertia_std": estimate.inertia_std,
        "bias_covariance": estimate.bias_covariance,
        "delay_std": estimate.delay_std,
        "unidentified": estimate.unidentified,
        "condition_number": estimate.condition_number,
        "n_effective": estimate.n_effective,
        "residual_force": estimate.residual_force,
        "residual_torque": estimate.residual_torque,
        "frame_id": estimate.frame_id,
        "stamp": estimate.stamp * 1e-9,
        "findings": findings_json(estimate.findings),
        "fit": fit_json(estimate.fit),
        "segments": segments_json(answer),
        "source": answer.source,
        "bag": str(bag),
        "losses": losses,
        "warnings": [*(f"{bag}: {sentence}" for sentence in read), *_doubts(answer)],
    }


def write_report(folder: Path, bag: Path, answer: Identification) -> list[Path]:
    """Write the HTML report, and the Rerun scene when rerun is installed.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    # Drawing libraries load slowly: only now.
    from poise.viewing import write_identification_recording, write_identification_report

    written = [write_identification_report(folder, answer, title=f"Payload of {bag.name}", source=str(bag))]
    return add_scene(written, lambda: write_identification_recording(folder / "identification.rrd", answer))


def print_answer(people: Console, bag: Path, answer: Identification) -> None:
    """The answer as a table with one-sigma uncertainties, and the data it is based on."""
    estimate = answer.estimate
    title = escape(readable(f"{bag.name}, in the axes of {estimate.frame_id}"))
    table = Table("", "", title=title, title_justify="left")
    for heading in ("value", "one sigma"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    groups = {"m": "payload", "cx": "centre of mass", "ixx": "inertia about it"}
    for row in parameter_rows(answer):
        seen = row.value if not row.reason else "not seen"
        table.add_row(groups.get(row.name, ""), row.symbol, seen, row.sigma, row.unit, end_section=row.name == "izz")
    deviations = np.sqrt(np.diag(estimate.bias_covariance))
    for index, (value, sigma) in enumerate(zip(estimate.bias, deviations, strict=True)):
        group = {0: "force bias", 3: "torque bias"}.get(index, "")
        shown, spread = rounded(float(value), float(sigma))
        unit = "N" if index < 3 else "N m"
        table.add_row(group, "xyz"[index % 3], shown if np.isfinite(value) else "not seen", spread, unit)
    people.print(table)
    if (segments := segment_table(answer)) is not None:
        people.print(segments)
    for name, text in _facts(answer):
        people.print(f"{name:11}{escape(readable(text, 500))}", soft_wrap=True)


def _facts(answer: Identification) -> list[tuple[str, str]]:
    """What stands below the table, name and sentence."""
    estimate = answer.estimate
    reasons: dict[str, int] = {}
    for span in estimate.rejected:
        reasons[span.reason] = reasons.get(span.reason, 0) + span.n_samples
    left_out = ", ".join(f"{count} {reason}" for reason, count in reasons.items()) or "none"
    used = f"{estimate.n_samples} used, equivalent to {estimate.n_effective:.0f} independent ones"
    late = (
        ""
        if np.isnan(estimate.delay)
        else "; stamps of the wrench are {} ± {} ms late against the motion".format(
            *rounded(1e3 * estimate.delay, 1e3 * estimate.delay_std)
        )
    )
    return [
        ("method", f"{estimate.method}; motion from {answer.source}{late}"),
        ("samples", f"{used}; rejected: {left_out}"),
        ("residual", f"{estimate.residual_force:.3g} N and {estimate.residual_torque:.3g} N m rms per axis"),
        ("physics", _physics(estimate)),
        ("fit", fit_words(estimate.fit)),
    ]


def _physics(estimate: InertialEstimate) -> str:
    if not np.isfinite(estimate.phi[:4]).all():
        return "not known"
    return "physically consistent" if estimate.consistent else "NOT PHYSICALLY CONSISTENT"


def _doubts(answer: Identification) -> list[str]:
    """Warnings that qualify an answer, one sentence each."""
    estimate = answer.estimate
    doubts = [finding.message for finding in estimate.findings]
    if not estimate.consistent and np.isfinite(estimate.phi[:4]).all():
        doubts.append("no body with this mass and inertia can exist: move more, or faster, about every axis")
    return doubts
