"""`--export KIND[:FILE]`: an identified payload in the formats of simulators, planners and robot controllers."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
import yaml

from poise.commands.output import STDOUT, refuse_folder, warn
from poise.errors import ErrorCode, InputError
from poise.exporting import (
    ExportedPayload,
    ExportSettings,
    GripperLoad,
    all_exporters,
    exported_payload,
    exporter_of,
    is_doubtful,
)
from poise.files import write_whole
from poise.geometry import Pose
from poise.inertia import InertialEstimate, InertialParameters
from poise.inertia.model import EstimateFinding, symmetric
from poise.recording import Recording, open_recording
from poise.robot import RobotModel, find_urdf, fixed_frames, read_urdf

_FLANGE_KINDS = ", ".join(each.kind for each in all_exporters() if each.flange)
_GRIPPER_WORDS = "give MASS,X,Y,Z or MASS,X,Y,Z,IXX,IXY,IXZ,IYY,IYZ,IZZ (kg, m, kg m2 about the centre of mass)"

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
FrameOption = Annotated[
    str | None,
    typer.Option(
        "--frame",
        metavar="NAME",
        help="Frame of the exported values, such as tool0 or flange. It must be fixed to the sensor in the robot"
        " description or in tf.",
        show_default=False,
    ),
]
FlangePoseOption = Annotated[
    str | None,
    typer.Option(
        "--flange-pose",
        metavar="'X Y Z QX QY QZ QW'",
        help="Instead of --frame: pose of the sensor frame in the robot's flange frame, m and a quaternion, for the"
        f" formats that take values there ({_FLANGE_KINDS}). Default: both coincide.",
        show_default=False,
    ),
]
GripperOption = Annotated[
    str | None,
    typer.Option(
        "--gripper",
        metavar="VALUES|FILE|urdf",
        help="Gripper to take off the exported payload, in the sensor frame: MASS,X,Y,Z[,IXX,IXY,IXZ,IYY,IYZ,IZZ]; or a"
        " JSON or YAML file with mass, com, inertia, as poise identify --json writes it for the empty gripper; or urdf:"
        " what the robot description has beyond the sensor.",
        show_default=False,
    ),
]
TransitionTimeOption = Annotated[
    float,
    typer.Option("--transition-time", help="s in which a UR changes its payload (ur, ur-driver).", min=0.0, max=60.0),
]


class ExportRequest(NamedTuple):
    """One `--export`: what, and where to; None is stdout."""

    kind: str
    target: Path | None


@dataclass(frozen=True)
class ExportPlan:
    """What the command line asks for, checked as far as it can be without the recording.

    Args:
        requests: one for each `--export`.
        flange_pose: of the sensor frame in the flange frame.
        frame: of the values.
        gripper: its values, or `urdf`.
        transition_time: s.
        urdf: the robot description; None: the recording's.
    """

    requests: tuple[ExportRequest, ...] = ()
    flange_pose: Pose | None = None
    frame: str | None = None
    gripper: GripperLoad | str | None = None
    transition_time: float = 0.0
    urdf: Path | None = None

    def settings(self, estimate: InertialEstimate, bag: Path) -> ExportSettings:
        """With the frames and the robot of the recording, which is opened only if it is needed.

        Raises:
            InputError: FRAME_UNKNOWN, with the frames that are fixed to the sensor; ROBOT_DESCRIPTION_MISSING.
        """
        settings = ExportSettings(self.flange_pose, transition_time=self.transition_time)
        if isinstance(self.gripper, GripperLoad):
            settings = replace(settings, gripper=self.gripper)
        in_robot = any(exporter_of(request.kind).robot for request in self.requests)
        if not (in_robot or self.frame or self.gripper == "urdf"):
            return settings
        recording = open_recording(bag)
        description = self._robot_description(recording, required=in_robot or self.gripper == "urdf")
        settings = replace(settings, robot_description=description)
        if self.gripper == "urdf" and description is not None:
            phi = RobotModel.from_urdf(description, estimate.frame_id).load_in_sensor
            settings = replace(settings, gripper=GripperLoad(InertialParameters.from_phi(phi)))
        if self.frame is not None:
            asked, advice = f"--frame {self.frame}", "; or give --flange-pose"
            pose = fixed_pose(asked, self.frame, estimate.frame_id, recording, description, advice)
            settings = replace(settings, frame_id=self.frame, frame_from_sensor=pose)
        return settings

    def _robot_description(self, recording: Recording, required: bool) -> str | None:
        try:
            return robot_description(recording, self.urdf)
        except InputError as error:
            if required or error.code is not ErrorCode.ROBOT_DESCRIPTION_MISSING:
                raise
            return None


def robot_description(recording: Recording, urdf: Path | None) -> str:
    """The URDF of a file or of a robot that comes with Poise; without one, that of the recording.

    Raises:
        InputError: ROBOT_DESCRIPTION_MISSING; as `read_urdf`.
    """
    return recording.robot_description() if urdf is None else read_urdf(find_urdf(urdf))


def fixed_pose(
    asked: str, frame: str, sensor: str, recording: Recording, description: str | None, advice: str = ""
) -> Pose:
    """The pose of the sensor frame in a frame that is fixed to it.

    Args:
        asked: the option with its value, for the message; `advice` ends it.

    Raises:
        InputError: FRAME_UNKNOWN, with the frames that are fixed to the sensor.
    """
    fixed = fixed_frames(sensor, recording, description)
    if frame not in fixed:
        raise InputError(
            ErrorCode.FRAME_UNKNOWN,
            f"{asked}: no frame of this name is fixed to {sensor}; these are: {', '.join(fixed)}{advice}",
        )
    return fixed[frame]


def read_exports(
    texts: Sequence[str] | None,
    json_target: str | None,
    flange_pose: str | None = None,
    frame: str | None = None,
    gripper: str | None = None,
    transition_time: float = 0.0,
    urdf: Path | None = None,
) -> ExportPlan:
    """The plan of the command line, checked before anything is computed.

    Raises:
        InputError: BAD_INPUT for an unknown kind, for a folder as file, for options that contradict each other or have
            no export, or when stdout carries the JSON already; as `read_gripper`.
    """
    requests = []
    for text in texts or ():
        kind, _, name = text.partition(":")
        exporter_of(kind)
        refuse_folder(name or None, "--export")
        requests.append(ExportRequest(kind, Path(name) if name else None))
    if json_target == STDOUT and any(request.target is None for request in requests):
        raise InputError(ErrorCode.BAD_INPUT, "--json - and --export without a file both write to stdout: name a file")
    named = {"--flange-pose": flange_pose, "--frame": frame, "--gripper": gripper}
    unused = [option for option, value in named.items() if value is not None]
    if unused and not requests:
        raise InputError(ErrorCode.BAD_INPUT, f"{unused[0]} is for --export: give --export KIND[:FILE] too")
    if flange_pose is not None and frame is not None:
        raise InputError(ErrorCode.BAD_INPUT, "--frame and --flange-pose both say where the values belong: give one")
    pose = read_pose(flange_pose, "--flange-pose")
    return ExportPlan(tuple(requests), pose, frame, read_gripper(gripper), transition_time, urdf)


def read_pose(text: str | None, option: str) -> Pose | None:
    """A pose of seven numbers, None for none.

    Raises:
        InputError: BAD_INPUT.
    """
    if text is None:
        return None
    numbers = _numbers(text)
    if len(numbers) != 7 or not any(numbers[3:]):
        raise InputError(ErrorCode.BAD_INPUT, f"{option} {text!r}: give seven numbers, x y z qx qy qz qw")
    return Pose.from_vector(np.array(numbers))


def read_gripper(text: str | None) -> GripperLoad | str | None:
    """The gripper of `--gripper`: numbers, or a file with `mass`, `com`, `inertia` and perhaps `covariance`.

    Raises:
        InputError: BAD_INPUT, FILE_UNREADABLE.
    """
    if text is None or text == "urdf":
        return text
    numbers = _numbers(text)
    content: Any = {"mass": numbers[0], "com": numbers[1:4], "inertia": numbers[4:] or None} if numbers else None
    if not numbers:
        try:
            content = yaml.safe_load(Path(text).read_text(encoding="utf-8"))
        except OSError as error:
            sentence = f"--gripper {text}: no such file ({error.strerror}), and no numbers: {_GRIPPER_WORDS}"
            raise InputError(ErrorCode.FILE_UNREADABLE, sentence) from error
        except (UnicodeDecodeError, yaml.YAMLError) as error:
            raise InputError(ErrorCode.BAD_INPUT, f"--gripper {text} is neither JSON nor YAML") from error
    try:
        gripper, doubts = _gripper(content), [each.message for each in _findings(content) if is_doubtful(each)]
    except (TypeError, ValueError, KeyError, IndexError, AttributeError) as error:
        raise InputError(ErrorCode.BAD_INPUT, f"--gripper {text!r}: {_GRIPPER_WORDS}, or a file with these") from error
    if doubts:
        raise InputError(ErrorCode.BAD_INPUT, f"--gripper {text}: its own weighing may be wrong: {doubts[0]}")
    return gripper


def _gripper(content: dict[str, Any]) -> GripperLoad:
    mass, com = float(content["mass"]), np.array(content["com"], dtype=np.float64)
    given = content.get("inertia")
    six = np.array([np.nan] * 6 if given is None else given, dtype=np.float64)
    known = np.isfinite(mass) and mass >= 0 and np.isfinite(com).all()
    if six.shape != (6,) or com.shape != (3,) or not known:
        raise ValueError("not a gripper")
    if mass == 0:
        six = np.zeros(6)
    parameters = InertialParameters(mass, com, symmetric(six))
    if given is not None and mass > 0 and np.isfinite(six).all() and not parameters.is_consistent:
        raise ValueError("no body has this inertia")
    stated, frame = content.get("covariance"), content.get("frame_id")
    covariance = None if stated is None else np.array(stated, dtype=np.float64).reshape(10, 10)
    return GripperLoad(parameters, covariance, None if frame is None else str(frame))


def _findings(content: dict[str, Any]) -> list[EstimateFinding]:
    return [
        EstimateFinding(ErrorCode(each["code"]), str(each["sentence"]), dict(each.get("evidence", {})))
        for each in content.get("findings", ())
    ]


def _numbers(text: str) -> list[float]:
    """Finite numbers with spaces or commas between; empty when one of them is none."""
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        return []
    return numbers if np.isfinite(numbers).all() else []


def write_exports(plan: ExportPlan, estimate: InertialEstimate, bag: Path) -> list[Path]:
    """Write every request, or nothing when one of them cannot be expressed; return the files.

    Raises:
        NoAnswerError: as `Exporter.check`. InputError: FILE_UNWRITABLE; as `ExportPlan.settings`.
    """
    if not plan.requests:
        return []
    settings = plan.settings(estimate, bag)
    payloads = [exported_payload(estimate, request.kind, settings) for request in plan.requests]
    texts = [exporter_of(request.kind).text(each) for request, each in zip(plan.requests, payloads, strict=True)]
    written = []
    for request, payload, text in zip(plan.requests, payloads, texts, strict=True):
        for remark in _remarks(request.kind, payload):
            warn(remark)
        if request.target is None:
            sys.stdout.write(text)
        else:
            written.append(write_whole(request.target, text.encode()))
    return written


def _remarks(kind: str, payload: ExportedPayload) -> list[str]:
    """What the format leaves out, and what it assumes."""
    exporter, sensor = exporter_of(kind), payload.estimate.frame_id
    remarks = [f"{kind} cannot express {', '.join(exporter.omits)}"] if exporter.omits else []
    placed = payload.settings.frame_id or payload.settings.flange_from_sensor
    if exporter.flange and placed is None:
        remarks.append(
            f"{kind} expects values in the flange frame; {sensor} is taken as the flange: give --frame or --flange-pose"
        )
    if payload.assumed and "inertia" not in exporter.omits and not exporter.doubtful:
        remarks.append(f"{kind}: the motion does not show {', '.join(payload.assumed)}; expected values were written")
    elif not payload.has_inertia and not {"inertia"} & {*exporter.omits, *exporter.needs} and not exporter.doubtful:
        remarks.append(f"{kind}: the inertia is not known and was left out; the robot then takes zero")
    return remarks
