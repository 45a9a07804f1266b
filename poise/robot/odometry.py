"""The motion of a robot's root link from odometry."""

import numpy as np
from scipy.spatial.transform import Rotation

from poise.recording import PoseStream
from poise.robot.kinematics import BaseMotion
from poise.robot.resampled import resample
from poise.types import Array, Mask


def base_motion_at(odometry: PoseStream, start: int, seconds: Array) -> tuple[BaseMotion, Mask]:
    """The root link's motion at other times, and the mask (N,) where it is known.

    Attitude is differentiated in yaw, pitch and roll: a base may turn many times, and never pitches by 90 degrees.

    Args:
        odometry: poses of the root link in the world.
        start: ns, the stamp of second zero.
        seconds: (N,) s.

    Raises:
        InputError: TOO_FEW_SAMPLES.
    """
    sampled = np.asarray((odometry.stamps - start) * 1e-9)
    angles = np.unwrap(Rotation.from_matrix(odometry.rotation_parent_child).as_euler("ZYX"), axis=0)
    moved = resample(sampled, np.hstack([odometry.translation_parent_child, angles]), seconds)
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
