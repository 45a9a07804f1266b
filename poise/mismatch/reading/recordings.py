"""From a bag to a `RecordedMotion`: which streams there are, on one clock, what was lost, and what cannot be right."""

from dataclasses import dataclass, replace
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.inertia.pipeline import recorded_gravity
from poise.mismatch.effects import SLOWEST_VIBRATION, slow_part
from poise.mismatch.reading.kinematics import Motion, base_joints, effort_track, recorded_from_motion
from poise.mismatch.reading.nominal_model import NominalModel
from poise.mismatch.reading.payload import identified, loosened
from poise.mismatch.reading.sanity import check_positions, check_rates, check_wrench, without_spikes
from poise.mismatch.reading.smoothing import smooth, taken
from poise.mismatch.recorded import EffortTrack, RecordedMotion, at_times, load_wrench
from poise.recording import JointStream, PoseStream, Recording, WrenchStream
from poise.robot import BaseMotion, RobotModel, find_imu, find_kinematics, find_urdf, parse_urdf, read_urdf
from poise.types import Array, Mask

MAX_WRENCH_RATE = 250.0
"""Hz; a faster wrench is averaged down to about this."""
MAX_WRENCH_SAMPLES, MIN_WRENCH_RATE = 15_000, 25.0
"""Wrench samples of a recording that are compared, of long ones averaged further, down to this rate in Hz."""
_BESIDE = 0.1
"""s by which an accelerometer may begin later than the wrench, or end earlier."""


@dataclass(frozen=True, eq=False)
class ReadRecording:
    """A recording as a world, with what there is to say about how it was read."""

    recorded: RecordedMotion
    model: NominalModel
    robot: RobotModel | None
    notes: tuple[str, ...]


def read_recording(recording: Recording, model: NominalModel) -> ReadRecording:
    """Read a bag.

    Args:
        recording: with the wrench, and joint states with a robot description, or tf up to the sensor.
        model: the nominal simulation; a payload that it leaves out is identified from the recording.

    Raises:
        InputError: TOPIC_MISSING, JOINT_MISSING, ROBOT_DESCRIPTION_MISSING, FRAME_UNKNOWN, TOO_FEW_SAMPLES, BAD_INPUT
            for a wrench in wrong units or of the other sign, EMPTY when wrench and motion never overlap.
    """
    wrench = recording.wrench()
    frame = model.sensor_frame or wrench.frame_id or "ft_sensor"
    gravity = recorded_gravity(recording) if model.gravity is None else model.gravity
    model = replace(model, sensor_frame=frame, gravity=gravity)
    wrench, notes = usable(wrench)
    notes = [*(loss.sentence for loss in recording.losses), *notes]
    joints, robot, odom = _robot(recording, model, frame)

    def build(phi: Array) -> tuple[RecordedMotion, list[str]]:
        if robot is None or joints is None:
            return _from_tf(recording, frame, wrench, phi, gravity)
        carried = phi + robot.load_in_sensor if model.tool_in_wrench else phi
        return recorded_from_streams(robot, joints, odom, wrench, carried, gravity)

    recorded, said = build(np.zeros(10) if model.phi is None else model.phi)
    if model.phi is None:
        tool = robot.load_in_sensor if model.tool_in_wrench and robot is not None else np.zeros(10)
        model = replace(
            model, phi=identified(recorded) - tool, tolerance=loosened(model.tolerance), payload_identified=True
        )
        recorded, said = build(model.phi if model.phi is not None else np.zeros(10))
    check_wrench(recorded, str(recording.path))
    recorded, spikes = without_spikes(recorded)
    return ReadRecording(recorded, model, robot, (*notes, *said, *spikes))


def usable(wrench: WrenchStream) -> tuple[WrenchStream, list[str]]:
    """Without NaN and repeated stamps, at no more than MAX_RATE, and no longer than MOST_SAMPLES last."""
    notes = []
    finite = np.isfinite(wrench.wrench_in_sensor).all(axis=1)
    if not finite.all():
        notes.append(f"{int((~finite).sum())} wrench samples are not finite and were left out")
    fresh = np.concatenate([[True], np.diff(wrench.stamps) > 0])
    wrench = wrench.select(finite & fresh)
    if len(wrench) < 100:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"{len(wrench)} usable wrench samples are too few to compare: record ten seconds or more at 50 Hz or more",
        )
    longest = MAX_WRENCH_SAMPLES / MIN_WRENCH_RATE
    inside = wrench.stamps - wrench.stamps[0] <= longest * 1e9
    if not inside.all():
        notes.append(f"the recording is longer than {longest:.0f} s: only that much of its beginning was compared")
        wrench = wrench.select(inside)
    period = float(np.median(np.diff(wrench.stamps))) * 1e-9
    rate = min(MAX_WRENCH_SAMPLES / (len(wrench) * period), MAX_WRENCH_RATE)
    together = int(np.ceil(1.0 / period / rate - 0.05))
    if together > 1:
        count = len(wrench) // together * together
        stamps = wrench.stamps[:count].reshape(-1, together)
        mean = (stamps - stamps[:, :1]).mean(axis=1).round().astype(np.int64) + stamps[:, 0]
        values = wrench.wrench_in_sensor[:count].reshape(-1, together, 6).mean(axis=1)
        wrench = WrenchStream(mean, values, wrench.frame_id)
        notes.append(f"the wrench came at {1 / period:.0f} Hz; {together} samples each were averaged")
    return wrench, notes


def _robot(
    recording: Recording, model: NominalModel, frame: str
) -> tuple[JointStream | None, RobotModel | None, PoseStream | None]:
    """Joint states with a robot that they move; odometry when the root of that robot moves."""
    has = {topic.strip("/").rpartition("/")[2] for topic in recording.topics}
    if "joint_states" not in has:
        if "tf" not in has:
            raise InputError(
                ErrorCode.TOPIC_MISSING,
                f"{recording.path} has no joint_states and no tf: nothing says how the sensor moved; record them too",
            )
        return None, None, None
    text = read_urdf(find_urdf(model.urdf)) if model.urdf is not None else recording.robot_description()
    robot = RobotModel.from_urdf(text, frame)
    odom = recording.odometry() if "odom" in has else None
    try:
        joints = recording.joint_states(names=robot.joint_names)
    except InputError as error:
        base = base_joints(robot)
        if error.code is not ErrorCode.JOINT_MISSING or odom is None or not base:
            raise
        joints = recording.joint_states(names=robot.joint_names[base:])
        robot = RobotModel.from_urdf(_locked(text, robot.joint_names[:base]), frame, base="floating")
        return joints, robot, odom
    if odom is not None and base_joints(robot) == 0:
        return joints, RobotModel.from_urdf(text, frame, base="floating"), odom
    return joints, robot, None


def _locked(text: str, names: tuple[str, ...]) -> str:
    """A URDF with these joints fixed: odometry says where they put the base."""
    root = ElementTree.fromstring(parse_urdf(text).text.strip())
    for joint in root.findall("joint"):
        if joint.get("name") in names:
            joint.set("type", "fixed")
    return ElementTree.tostring(root, encoding="unicode")


def recorded_from_streams(
    robot: RobotModel, joints: JointStream, odom: PoseStream | None, wrench: WrenchStream, phi: Array, gravity: float
) -> tuple[RecordedMotion, list[str]]:
    """A world from streams, and what there is to say about them; arguments as `read_recording` has them.

    Raises:
        InputError: JOINT_MISSING, TOO_FEW_SAMPLES, EMPTY.
    """
    position, rates = robot.order(joints.names, joints.position, joints.velocity)
    check_positions(robot, position)
    finite = np.isfinite(position).all(axis=1)
    notes = [] if finite.all() else [f"{int((~finite).sum())} joint states are not finite and were left out"]
    check_rates(joints, wrench)
    start = int(wrench.stamps[0])
    sampled = _seconds(joints.stamps[finite], start)
    seconds = taken(_seconds(wrench.stamps, start), wrench.wrench_in_sensor)[0]
    moved = smooth(sampled, position[finite], seconds, rates[finite])
    base, known = _odometry(odom, start, seconds) if odom is not None else (None, np.ones(len(seconds), dtype=bool))
    known &= moved.known
    if known.sum() < 100:
        raise InputError(
            ErrorCode.EMPTY,
            f"wrench and joint states overlap in {int(known.sum())} samples only: are their clocks the same? "
            f"joint states run from {sampled[0]:.3f} s to {sampled[-1]:.3f} s after the first wrench",
        )
    if not known.all():
        notes.append(f"{int((~known).sum())} wrench samples have no joint motion around them and were left out")
    if moved.jitter > 0:
        notes.append(f"joint stamps jitter by {1e3 * moved.jitter:.2f} ms about a regular clock: that clock was used")
    motion = Motion(moved.position[known], moved.velocity[known], moved.acceleration[known], _at(base, known))
    (efforts,) = robot.order(joints.names, joints.effort)
    effort = None
    if np.isfinite(efforts[finite]).all(axis=0).any():
        effort = _efforts(robot, (sampled, position[finite], rates[finite], efforts[finite]), odom, start, phi)
    recorded = recorded_from_motion(
        robot,
        seconds[known],
        motion,
        phi,
        wrench.wrench_in_sensor[known],
        gravity=gravity,
        start=start,
        effort=effort if effort is not None and effort.names else None,
    )
    return recorded, notes


def _efforts(
    robot: RobotModel, samples: tuple[Array, Array, Array, Array], odom: PoseStream | None, start: int, phi: Array
) -> EffortTrack:
    """Efforts at the stamps of the joint states (seconds, position, velocity, effort), where all motion is known."""
    seconds, position, rates, efforts = samples
    inner = (seconds > seconds[0] + 0.1) & (seconds < seconds[-1] - 0.1)
    at = seconds[inner]
    moved = smooth(seconds, position, at, rates)
    base, known = _odometry(odom, start, at) if odom is not None else (None, np.ones(len(at), dtype=bool))
    known &= moved.known
    motion = Motion(moved.position[known], moved.velocity[known], moved.acceleration[known], _at(base, known))
    return effort_track(robot, at[known], motion, efforts[inner][known], phi)


def _seconds(stamps: NDArray[np.int64], start: int) -> Array:
    return np.asarray((stamps - start) * 1e-9, dtype=np.float64)


def _odometry(odom: PoseStream, start: int, seconds: Array) -> tuple[BaseMotion, Mask]:
    """The root link's motion at the wrench's stamps, and where it is known.

    Attitude is followed in yaw, pitch and roll: a base turns round many times, and never stands on its nose.
    """
    sampled = _seconds(odom.stamps, start)
    angles = np.unwrap(Rotation.from_matrix(odom.rotation_parent_child).as_euler("ZYX"), axis=0)
    moved = smooth(sampled, np.hstack([odom.translation_parent_child, angles]), seconds)
    place, rate, second = (values[:, :3] for values in (moved.position, moved.velocity, moved.acceleration))
    angle, turn, change = (values[:, 3:] for values in (moved.position, moved.velocity, moved.acceleration))
    known = moved.known
    rotation = np.full((len(seconds), 3, 3), np.nan)
    rotation[known] = Rotation.from_euler("ZYX", angle[known]).as_matrix()
    # omega = E(angles) d angles / dt in base axes, E by pitch and roll (Siciliano et al. 2009, section 2.4).
    matrix, matrix_rate = _euler_rates(angle, turn)
    omega = np.einsum("nij,nj->ni", matrix, turn)
    alpha = np.einsum("nij,nj->ni", matrix, change) + np.einsum("nij,nj->ni", matrix_rate, turn)

    def in_base(values: Array) -> Array:
        return np.asarray(np.einsum("nji,nj->ni", rotation, values))

    return BaseMotion(rotation, place, in_base(rate), omega, in_base(second), alpha), known


def _euler_rates(angle: Array, turn: Array) -> tuple[Array, Array]:
    """(N, 3, 3) from the rates of yaw, pitch, roll to the angular velocity in body axes, and its rate."""
    _, pitch, roll = angle.T
    _, dpitch, droll = turn.T
    (sp, cp), (sr, cr), zero = (np.sin(pitch), np.cos(pitch)), (np.sin(roll), np.cos(roll)), np.zeros(len(angle))
    matrix = [[-sp, zero, zero + 1.0], [sr * cp, cr, zero], [cr * cp, -sr, zero]]
    rate = [
        [-cp * dpitch, zero, zero],
        [cr * cp * droll - sr * sp * dpitch, -sr * droll, zero],
        [-sr * cp * droll - cr * sp * dpitch, -cr * droll, zero],
    ]
    return np.moveaxis(np.array(matrix), 2, 0), np.moveaxis(np.array(rate), 2, 0)


def _at(base: BaseMotion | None, known: Mask) -> BaseMotion | None:
    return None if base is None else BaseMotion(*(value[known] for value in vars(base).values()))


def _from_tf(
    recording: Recording, frame: str, wrench: WrenchStream, phi: Array, gravity: float
) -> tuple[RecordedMotion, list[str]]:
    """A world from the sensor's poses alone: no joints, and accelerations as far as poses or an accelerometer tell."""
    kinematics = find_kinematics(recording, frame)
    kinematics.feed(None, None)
    newest = kinematics.source.newest
    motion = kinematics.source.motion(0, newest if newest is not None else 0)
    start = int(wrench.stamps[0])
    sampled, seconds = _seconds(motion.stamps, start), _seconds(wrench.stamps, start)
    known = (seconds >= sampled[0]) & (seconds <= sampled[-1])
    if known.sum() < 100:
        raise InputError(ErrorCode.EMPTY, f"{recording.path}: wrench and tf overlap in {int(known.sum())} samples only")
    seconds = seconds[known]

    def carried(values: Array) -> Array:
        return at_times(sampled, values.reshape(len(values), -1), seconds)

    left, _, right = np.linalg.svd(carried(motion.rotation_world_sensor).reshape(-1, 3, 3))
    rotation = left @ right
    down = np.array([0.0, 0.0, -gravity]) @ rotation
    linear = carried(motion.linear_acceleration_in_sensor)
    omega, alpha = carried(motion.angular_velocity_in_sensor), carried(motion.angular_acceleration_in_sensor)
    felt, notes = _felt(recording, frame, start, seconds, down), []
    if felt is not None and not kinematics.has_positions:
        linear = slow_part(seconds, felt)
        notes.append(
            f"tf has no positions: the part of the imu below {SLOWEST_VIBRATION:.0f} Hz is taken for the motion"
        )
    poses = kinematics.source.poses(int(motion.stamps[0]), int(motion.stamps[-1]))
    place = at_times(_seconds(poses.stamps, start), poses.translation, seconds)
    recorded = RecordedMotion(
        start=start,
        seconds=seconds,
        wrench=wrench.wrench_in_sensor[known],
        phi=phi,
        prediction=load_wrench(phi, down - linear, omega, alpha),
        gravity=down,
        linear_acceleration=linear,
        angular_velocity=omega,
        angular_acceleration=alpha,
        rotation_world_sensor=rotation,
        position_in_world=place,
        velocity_in_world=np.gradient(place, seconds, axis=0),
        accelerometer=felt,
    )
    return recorded, notes


def _felt(recording: Recording, frame: str, start: int, seconds: Array, down: Array) -> Array | None:
    """(N, 3) acceleration of the sensor by an accelerometer that rides on it, without its offset; None without one."""
    imu = find_imu(recording, frame)
    if imu is None:
        return None
    stamps = _seconds(imu.stamps, start)
    if len(stamps) < 10 or stamps[0] > seconds[0] + _BESIDE or stamps[-1] < seconds[-1] - _BESIDE:
        return None
    # A wrench sample is an average over about its period: so is what it is held against.
    period = float(np.median(np.diff(seconds)))
    parts = [at_times(stamps, imu.specific, seconds + shift * period) for shift in (-1 / 3, 0.0, 1 / 3)]
    felt = down - np.mean(parts, axis=0)
    return np.asarray(felt - felt.mean(axis=0))
