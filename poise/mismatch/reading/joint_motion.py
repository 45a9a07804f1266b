"""From joint states, odometry and a wrench to a `RecordedMotion`."""

import numpy as np
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.mismatch.reading.kinematics import Motion, effort_track, recorded_from_motion
from poise.mismatch.reading.sanity import check_positions, check_rates
from poise.mismatch.reading.smoothing import smooth, taken
from poise.mismatch.recorded import EffortTrack, RecordedMotion
from poise.recording import JointStream, PoseStream, WrenchStream
from poise.robot import BaseMotion, RobotModel
from poise.types import Array, Mask, Stamps


def seconds_since(stamps: Stamps, start: int) -> Array:
    """(N,) s from `start`, ns, to each stamp."""
    return np.asarray((stamps - start) * 1e-9, dtype=np.float64)


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
    sampled = seconds_since(joints.stamps[finite], start)
    seconds = taken(seconds_since(wrench.stamps, start), wrench.wrench_in_sensor)[0]
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


def _odometry(odom: PoseStream, start: int, seconds: Array) -> tuple[BaseMotion, Mask]:
    """The root link's motion at the wrench's stamps, and where it is known.

    Attitude is followed in yaw, pitch and roll: a base turns round many times, and never stands on its nose.
    """
    sampled = seconds_since(odom.stamps, start)
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
