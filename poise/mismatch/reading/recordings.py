"""From a recording or live streams to a `RecordedMotion`: which streams there are, and what is invalid."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.pipeline import recorded_gravity
from poise.mismatch.reading.commands import command_track, tracking
from poise.mismatch.reading.effort_input import checked_efforts
from poise.mismatch.reading.findings import InputFinding
from poise.mismatch.reading.frame_motion import recorded_from_frames
from poise.mismatch.reading.joint_input import check_joints
from poise.mismatch.reading.joint_motion import recorded_from_streams, seconds_since
from poise.mismatch.reading.joint_samples import usable_joints
from poise.mismatch.reading.joints_by_efforts import check_joints_by_efforts
from poise.mismatch.reading.measured_streams import MeasuredStreams, holds, recorded_streams
from poise.mismatch.reading.nominal_model import NominalModel
from poise.mismatch.reading.payload import identified, loosened
from poise.mismatch.reading.sanity import (
    check_frame_motion,
    check_motion,
    check_payload,
    contradicted,
    light_robot,
    without_frozen,
    without_spikes,
)
from poise.mismatch.reading.simulator import (
    nominal_description,
    sensor_frame_of,
    with_simulator,
    with_stated_physics,
)
from poise.mismatch.reading.wrench_input import check_wrench
from poise.mismatch.reading.wrench_samples import usable
from poise.mismatch.recorded import RecordedMotion
from poise.recording import JointStream, PoseStream, Recording
from poise.robot import RobotModel, chains, robot_of, usable_odometry
from poise.simulation.models import urdf_physics
from poise.types import Array

_WRENCH = ("wrench", "geometry_msgs/msg/WrenchStamped")
_STATES = ("joint_states", "sensor_msgs/msg/JointState")


@dataclass(frozen=True, eq=False)
class ReadRecording:
    """A recording, or a live window, held against the nominal model.

    Args:
        recorded: the motion with measured and predicted wrench.
        model: the nominal model, with what the recording adds to it (sensor frame, gravity, payload).
        robot: None when the motion came from tf.
        joints: the joint states that moved the robot; None when the motion came from tf.
        notes: sentences on losses, corrections and findings.
        findings: what the recording itself shows to be wrong or missing.
    """

    recorded: RecordedMotion
    model: NominalModel
    robot: RobotModel | None
    joints: JointStream | None
    notes: tuple[str, ...]
    findings: tuple[InputFinding, ...] = ()


def read_recording(recording: Recording, model: NominalModel, called: Mapping[str, str] | None = None) -> ReadRecording:
    """Read a bag.

    Args:
        recording: with joint states and a robot description, and the wrench, joint efforts, or both; or with the wrench
            and tf up to the sensor.
        model: the nominal simulation; a payload that it leaves out is identified from the recording.
        called: other names of the joints, by those that the recording has.

    Raises:
        InputError: TOPIC_MISSING, JOINT_MISSING, ROBOT_DESCRIPTION_MISSING, FRAME_UNKNOWN, TOO_FEW_SAMPLES, BAD_INPUT
            for a wrench in wrong units or of the other sign, EMPTY when wrench and motion never overlap.
        NoAnswerError: TOPIC_MISSING for commands without states, JOINT_MISSING for states of another robot,
            NOT_IDENTIFIABLE for joint efforts without motion.
    """
    known = replace(model, gravity=recorded_gravity(recording) if model.gravity is None else model.gravity)
    losses = tuple(loss.sentence for loss in recording.losses)
    if holds(recording, "joint_states"):
        return _of_joint_states(recording, known, losses, called)
    if holds(recording, "joint_commands") and not holds(recording, "tf"):
        raise NoAnswerError(
            ErrorCode.TOPIC_MISSING,
            f"{recording.path} has joint_commands, but no joint_states: they say what the robot was to do, not what it "
            "did; record joint_states too",
        )
    if not holds(recording, "tf"):
        raise InputError(
            ErrorCode.TOPIC_MISSING,
            f"{recording.path} has no joint_states and no tf: nothing says how the sensor moved; "
            f"{_elsewhere(recording, _STATES) or 'record them too'}",
        )
    measured, notes = usable(recording.wrench())
    frame = model.sensor_frame or measured.frame_id or "ft_sensor"

    def build(phi: Array) -> tuple[RecordedMotion, list[str]]:
        return recorded_from_frames(recording, frame, measured, phi, known.gravity_or_standard)

    known = replace(known, sensor_frame=frame)
    recorded, known, corrections, frozen = _against(build, str(recording.path), known, np.zeros(10))
    findings = [*frozen, *check_frame_motion(recorded), *contradicted(recorded, model)]
    said = tuple(finding.sentence for finding in findings)
    return ReadRecording(recorded, known, None, None, (*losses, *notes, *corrections, *said), tuple(findings))


def _of_joint_states(
    recording: Recording, known: NominalModel, losses: tuple[str, ...], called: Mapping[str, str] | None
) -> ReadRecording:
    wrench = recording.wrench() if holds(recording, "wrench") else None
    other = _elsewhere(recording, _WRENCH) if wrench is None else ""
    streams = recorded_streams(recording, wrench, called)
    try:
        read = read_streams(streams, known, (*losses, other) if other else losses)
    except InputError as error:
        if error.code is not ErrorCode.TOPIC_MISSING or not other:
            raise
        raise InputError(error.code, f"{error.message}; {other}") from error
    return replace(read, notes=(*recording.clocks.values(), *read.notes))


def _elsewhere(recording: Recording, wanted: tuple[str, str]) -> str:
    """Which topics have messages of the type of a missing topic (name, type); "" where none has."""
    name, kind = wanted
    found = [topic for topic, there in recording.topics.items() if there == kind]
    return f"{' '.join(found)} ({kind}) was not read: rename it to {name}" if found else ""


def read_streams(streams: MeasuredStreams, model: NominalModel, losses: Sequence[str] = ()) -> ReadRecording:
    """Read the joint states and the wrench of a recording or of a live window.

    Args:
        streams: with the wrench, joint states and the robot's description.
        model: the nominal simulation; a payload that it leaves out is identified from the streams.
        losses: sentences on what is missing.

    Raises:
        InputError: as `read_recording`.
    """
    wrench, losses = streams.wrench, list(losses)
    if wrench is not None:
        wrench, notes = usable(wrench)
        losses += notes
    text = nominal_description(model, streams.description)
    joints, robot, odometry = _robot(streams, model, text)
    if odometry is not None:
        odometry, notes = usable_odometry(odometry)
        losses += notes
    model = with_simulator(model, robot)
    frame = robot.sensor_frame
    joints, notes, wrong = usable_joints(joints, robot, alone=wrench is None)
    tool = robot.load_in_sensor if model.tool_in_wrench else np.zeros(10)

    def build(phi: Array) -> tuple[RecordedMotion, list[str]]:
        return recorded_from_streams(robot, joints, odometry, wrench, phi, model.gravity_or_standard, tool)

    check_payload(robot, model.phi)
    known = replace(model, sensor_frame=frame)
    recorded, known, corrections, frozen = _against(build, streams.name, known, tool, wrench is not None)
    if wrench is not None and model.phi is not None:
        check_joints(robot, recorded, model.phi + tool, streams.name)
    recorded, findings = _checked(recorded, robot, joints, streams)
    recorded = with_stated_physics(recorded, known)
    notes = [*notes, *_not_predicted(recorded, model, text)]
    stated = contradicted(recorded, model) if wrench is not None else []
    findings = [*wrong, *_held(model, robot, text, streams), *frozen, *findings, *stated]
    said = tuple(finding.sentence for finding in findings)
    return ReadRecording(recorded, known, robot, joints, (*losses, *notes, *corrections, *said), tuple(findings))


def _not_predicted(recorded: RecordedMotion, model: NominalModel, description: str) -> list[str]:
    """What a robot description states of joints with efforts, where the model does not predict it."""
    if recorded.effort is None or model.simulator is not None or model.effects:
        return []
    stated = urdf_physics(description)
    joints = [name for name in recorded.effort.names if name in stated]
    if not joints:
        return []
    said = "; ".join(f"{name} {', '.join(f'{key} {v:g}' for key, v in stated[name].values.items())}" for name in joints)
    return [
        f"the robot description states dynamics of joints ({said}), which the nominal model does not predict: "
        "`simulator: robot.urdf` in model.yaml predicts them"
    ]


def _checked(
    recorded: RecordedMotion, robot: RobotModel, joints: JointStream, streams: MeasuredStreams
) -> tuple[RecordedMotion, list[InputFinding]]:
    """The recording with usable efforts alone and with its commands, and what is wrong with its input."""
    (position,) = robot.order(joints.names, joints.position)
    findings = check_motion(robot.joint_names, position, recorded, streams.name)
    if not recorded.has("effort") and not recorded.has("wrench"):
        sentence = f"{streams.name} has no wrench and no joint efforts"
        if streams.commands is None:
            raise InputError(ErrorCode.TOPIC_MISSING, f"{sentence}: record one of them")
        findings.append(InputFinding("no_effort", f"{sentence}: only the motion can be compared with the commands."))
    if recorded.effort is not None:
        effort, wrong = None, light_robot(robot, recorded.phi)
        if not wrong:
            check_joints_by_efforts(robot, recorded, streams.name)
            effort, wrong = checked_efforts(recorded, recorded.effort)
        recorded = replace(recorded, effort=effort)
        findings += wrong
    if streams.commands is not None:
        start, end = recorded.start, int(joints.stamps[-1])
        commands = command_track(streams.commands, robot.joint_names, start, end)
        recorded = replace(recorded, commands=commands)
        seconds = seconds_since(joints.stamps, start)
        followed = None if commands is None else tracking(commands, robot.joint_names, seconds, position)
        findings += [] if followed is None else [followed]
    return recorded, findings


def _against(
    build: Callable[[Array], tuple[RecordedMotion, list[str]]],
    name: str,
    model: NominalModel,
    tool: Array,
    measures_wrench: bool = True,
) -> tuple[RecordedMotion, NominalModel, list[str], list[InputFinding]]:
    """The motion with the payload of the model, or with the payload that is identified beside the tool (10,).

    Returns:
        The motion; the model with the payload; what was corrected; what is wrong with the wrench.
    """
    if model.phi is None and not measures_wrench:
        phi = np.zeros(10)  # joint efforts alone: the robot of the URDF, its hand empty
    elif model.phi is None:
        phi = identified(build(np.zeros(10))[0]) - tool
        model = replace(model, phi=phi, tolerance=loosened(model.tolerance), payload_identified=True)
    else:
        phi = model.phi
    recorded, notes = build(phi)
    if not measures_wrench:
        return recorded, model, notes, []
    check_wrench(recorded, name)
    recorded, frozen = without_frozen(recorded)
    recorded, spikes = without_spikes(recorded)
    return recorded, model, [*notes, *spikes], frozen


def _held(model: NominalModel, robot: RobotModel, text: str, streams: MeasuredStreams) -> list[InputFinding]:
    """Joints of the robot's chain without states, and behind it where, without a wrench, the states chose its end.

    Raises:
        InputError: JOINT_MISSING for joints without states in front of others that have them.
    """
    alone = streams.wrench is None
    longest = next((names for _, names in chains(text) if set(robot.joint_names) <= set(names)), ())
    held = tuple(
        name
        for name in longest
        if name in model.joint_positions or (alone and model.sensor_frame is None and name not in robot.joint_names)
    )
    if not held or robot.base == "floating":
        return []
    behind = tuple(name for name in held if name not in model.joint_positions and _has_states(streams, name))
    if behind:
        lacking = " ".join(name for name in held if name not in behind)
        raise InputError(
            ErrorCode.JOINT_MISSING,
            f"{streams.name} has states of {' '.join(behind)}, but not of all joints before them: record {lacking}, or "
            "say in model.yaml where they stand, joint_positions",
        )
    places = tuple(model.joint_positions.get(name, 0.0) for name in held)
    said = ", ".join(f"{name} at {place:.3g}" for name, place in zip(held, places, strict=True))
    sentence = f"Joints without states are held: {said} rad (or m); what moves behind them is wrong if they moved."
    return [InputFinding("joints_held", sentence, held, places)]


def _has_states(streams: MeasuredStreams, name: str) -> bool:
    try:
        streams.joint_states((name,))
    except InputError:
        return False
    return True


def _robot(
    streams: MeasuredStreams, model: NominalModel, text: str
) -> tuple[JointStream, RobotModel, PoseStream | None]:
    """Joint states with a robot that they move; odometry when the root of that robot moves."""
    frame = sensor_frame_of(model, None if streams.wrench is None else streams.wrench.frame_id)
    if frame is None and streams.wrench is not None:
        frame = streams.wrench.frame_id or "ft_sensor"
    try:
        return robot_of(text, frame, streams.joint_states, streams.odometry, model.joint_positions)
    except InputError as error:
        there = error.data.get("there")
        if error.code is not ErrorCode.JOINT_MISSING or there is None:
            raise
        wanted = {name for _, names in chains(text) for name in names}
        if not wanted & set(there):
            raise NoAnswerError(
                ErrorCode.JOINT_MISSING,
                f"{streams.name}: the joint states are of another robot than the description: they are of "
                f"{' '.join(there)}, the description has {' '.join(sorted(wanted))}",
            ) from error
        lacking = " ".join(sorted(wanted - set(there)))
        raise InputError(
            ErrorCode.JOINT_MISSING,
            f"{error.message}; or say in model.yaml where joints without states stand, joint_positions; without "
            f"states: {lacking}",
            there=there,
        ) from error
