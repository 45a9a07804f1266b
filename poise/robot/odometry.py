"""The motion of a robot's root link from odometry, with its errors."""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from poise.recording import PoseStream
from poise.robot.differentiation import differentiate
from poise.robot.kinematics import BaseMotion
from poise.robot.resampled import resample
from poise.types import Array, Mask, Stamps

_CORNERS = 1.5
"""Factor on the stated errors of accelerations beside a measured twist. The acceleration of a base jumps, splines round
the corners, and noise hides it: the errors are 2.1 times the stated ones in trapezoidal motions, 0.7 in smooth ones."""


@dataclass(frozen=True, eq=False)
class MeasuredBase:
    """The motion of a base with its one-sigma errors.

    Args:
        motion: (N) of the root link.
        known: (N,) where it is known.
        velocity_sigma, acceleration_sigma: (N, 6) linear and angular, in base axes.
        place_noise: m, one sigma of a measured position; 0 where it was not asked for.
    """

    motion: BaseMotion
    known: Mask
    velocity_sigma: Array
    acceleration_sigma: Array
    place_noise: float = 0.0

    def select(self, mask: Mask) -> "MeasuredBase":
        """The samples that a mask (N,) picks."""
        sigmas = self.velocity_sigma[mask], self.acceleration_sigma[mask]
        return MeasuredBase(self.motion.select(mask), self.known[mask], *sigmas, self.place_noise)


def base_from_odometry(stamps: Stamps, rotation: Array, translation: Array, wanted: Stamps) -> MeasuredBase:
    """The motion of a base at the wanted stamps; a base at rest has no velocity and no acceleration.

    The noise of the odometry is that which its samples have about a spline.

    Args:
        stamps: (M,) ns of the odometry.
        rotation: (M, 3, 3), takes base axes to world axes.
        translation: (M, 3) m.
        wanted: (N,) ns.

    Raises:
        InputError: as `differentiate`.
    """
    found = differentiate(stamps, _pose_columns(rotation, translation))

    def at(values: Array) -> Array:
        columns = [np.interp(wanted, found.stamps, column, np.nan, np.nan) for column in values.T]
        return np.stack(columns, axis=1)

    derivatives = at(found.position), at(found.velocity), at(found.acceleration)
    return _measured_base(derivatives, (at(found.velocity_sigma), at(found.acceleration_sigma)))


def _measured_base(derivatives: tuple[Array, Array, Array], sigmas: tuple[Array, Array]) -> MeasuredBase:
    """Of the derivatives of `_pose_columns`, and the one-sigma errors of the first and the second one."""
    motion, known = _base_motion(*derivatives)
    in_base = []
    for sigma in sigmas:
        linear = np.sqrt(np.einsum("nji,nj->ni", motion.rotation_world_base**2, sigma[:, :3] ** 2))
        in_base.append(np.hstack([linear, sigma[:, :2:-1]]))  # yaw, pitch, roll turn about z, y, x
    return MeasuredBase(motion, known, in_base[0], in_base[1])


def base_motion_at(odometry: PoseStream, start: int, seconds: Array) -> MeasuredBase:
    """The root link's motion at other times, with its errors.

    Args:
        odometry: poses of the root link in the world.
        start: ns, the stamp of second zero.
        seconds: (N,) s.

    Raises:
        InputError: TOO_FEW_SAMPLES.
    """
    columns = _pose_columns(odometry.rotation_parent_child, odometry.translation_parent_child)
    twist = odometry.twist_in_child
    rates = None if twist is None else _pose_rates(columns[:, 3:], odometry.rotation_parent_child, twist)
    moved = resample(np.asarray((odometry.stamps - start) * 1e-9), columns, seconds, rates)
    second = moved.sigma[2] * (1.0 if twist is None else _CORNERS)
    found = _measured_base((moved.position, moved.velocity, moved.acceleration), (moved.sigma[1], second))
    return replace(found, place_noise=float(moved.noise[:3].max()))


def _pose_columns(rotation: Array, translation: Array) -> Array:
    """(N, 6) x, y, z in m and yaw, pitch, roll in rad without jumps, of poses (N, 3, 3), (N, 3).

    A base may turn many times, and never pitches by 90 degrees.
    """
    angles = scipy.spatial.transform.Rotation.from_matrix(rotation).as_euler("ZYX")
    return np.hstack([translation, np.unwrap(angles, axis=0)])


def _pose_rates(angle: Array, rotation: Array, twist_in_base: Array) -> Array:
    """(M, 6) rates of `_pose_columns` by the measured twist, at yaw, pitch, roll (M, 3) and rotation (M, 3, 3)."""
    linear = np.einsum("mij,mj->mi", rotation, twist_in_base[:, :3])
    matrix = _euler_rates(angle, np.zeros_like(angle))[0]
    return np.hstack([linear, np.linalg.solve(matrix, twist_in_base[:, 3:, None])[:, :, 0]])


def _base_motion(position: Array, velocity: Array, acceleration: Array) -> tuple[BaseMotion, Mask]:
    """The motion of the root link from the derivatives (N, 6) of `_pose_columns`, and where it is known (N,)."""
    known = np.asarray(np.isfinite(acceleration).all(axis=1))
    angle, turn, change = position[:, 3:], velocity[:, 3:], acceleration[:, 3:]
    rotation = np.full((len(position), 3, 3), np.nan)
    if known.any():
        rotation[known] = scipy.spatial.transform.Rotation.from_euler("ZYX", angle[known]).as_matrix()
    # omega = E(angles) d angles / dt in base axes, E by pitch and roll (Siciliano et al. 2009, section 2.4).
    matrix, matrix_rate = _euler_rates(angle, turn)
    omega = np.einsum("nij,nj->ni", matrix, turn)
    alpha = np.einsum("nij,nj->ni", matrix, change) + np.einsum("nij,nj->ni", matrix_rate, turn)

    def in_base(values: Array) -> Array:
        return np.asarray(np.einsum("nji,nj->ni", rotation, values))

    linear, second = in_base(velocity[:, :3]), in_base(acceleration[:, :3])
    return BaseMotion(rotation, position[:, :3], linear, omega, second, alpha), known


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
