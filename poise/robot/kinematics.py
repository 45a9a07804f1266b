"""Forward kinematics to second order: joint positions, velocities and accelerations -> how the sensor moved."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.kernels import COMPILED, chain_motion
from poise.robot.model import RobotModel
from poise.robot.motion import SensorMotion
from poise.types import Array, Mask


@dataclass(frozen=True)
class BaseMotion:
    """Motion of the robot's root link against the world, in base axes (coordinate acceleration, without gravity).

    Args:
        rotation_world_base: (N, 3, 3).
        translation_world_base: (N, 3) m.
        linear_velocity_in_base, angular_velocity_in_base: (N, 3) m/s, rad/s.
        linear_acceleration_in_base: (N, 3) m/s2 of the base's origin.
        angular_acceleration_in_base: (N, 3) rad/s2.
    """

    rotation_world_base: Array
    translation_world_base: Array
    linear_velocity_in_base: Array
    angular_velocity_in_base: Array
    linear_acceleration_in_base: Array
    angular_acceleration_in_base: Array

    def select(self, mask: Mask) -> "BaseMotion":
        """The samples that a mask (N,) picks."""
        return BaseMotion(*(value[mask] for value in vars(self).values()))

    @classmethod
    def planar(cls, pose: Array, velocity: Array, acceleration: Array) -> "BaseMotion":
        """Base on a level floor: (N, 3) x, y, yaw in the world, and their first and second time derivatives."""
        yaw = pose[:, 2]
        rotation = np.zeros((len(pose), 3, 3))
        rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(yaw)
        rotation[:, 1, 0] = np.sin(yaw)
        rotation[:, 0, 1] = -rotation[:, 1, 0]
        rotation[:, 2, 2] = 1.0

        def linear(values: Array) -> Array:
            in_world = np.column_stack([values[:, :2], np.zeros(len(values))])
            return np.asarray(np.einsum("nji,nj->ni", rotation, in_world))

        def angular(values: Array) -> Array:
            return np.column_stack([np.zeros((len(values), 2)), values[:, 2]])

        translation = np.column_stack([pose[:, :2], np.zeros(len(pose))])
        return cls(
            rotation, translation, linear(velocity), angular(velocity), linear(acceleration), angular(acceleration)
        )


@dataclass(frozen=True)
class PinocchioState:
    """Joint and base motion in pinocchio's coordinates: q (N, nq), v (N, nv), a (N, nv)."""

    q: Array
    v: Array
    a: Array


def _checked_joints(
    model: RobotModel, position: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike, base: "BaseMotion | None"
) -> Array:
    """(3, N, M) positions, velocities, accelerations of the model's moving joints, mimic joints included.

    Raises:
        InputError: as `pinocchio_state`.
    """
    arrays = [np.atleast_2d(np.asarray(value, dtype=np.float64)) for value in (position, velocity, acceleration)]
    expected = (len(arrays[0]), len(model.joint_names))
    for name, array in zip(("position", "velocity", "acceleration"), arrays, strict=True):
        if array.shape != expected:
            raise InputError(ErrorCode.TYPE_MISMATCH, f"joint {name} has shape {array.shape}, expected {expected}")
        if not np.isfinite(array).all():
            row, column = np.argwhere(~np.isfinite(array))[0]
            raise InputError(
                ErrorCode.NOT_FINITE, f"joint {name} of {model.joint_names[column]} is not finite in sample {row}"
            )
    if base is not None and model.base == "fixed":
        raise InputError(ErrorCode.UNSUPPORTED, "the base moves: build the robot model with base='floating'")
    moving = np.array(arrays) @ model.coupling.T
    moving[0] += model.offset
    return np.asarray(moving)


def _by_kernel(model: RobotModel, frame: str, joints: Array, base: BaseMotion | None) -> tuple[Array, Array, Array]:
    """As `chain_motion`, of a frame of the model."""
    chain, columns = model.chain(frame)
    rows = None
    if base is not None:
        parts = (
            base.rotation_world_base.reshape(-1, 9),
            base.translation_world_base,
            base.angular_velocity_in_base,
            base.angular_acceleration_in_base,
            base.linear_acceleration_in_base,
        )
        rows = np.concatenate(parts, axis=1)
    return chain_motion(chain, joints[:, :, columns], rows)


def pinocchio_state(
    model: RobotModel, position: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike, base: BaseMotion | None = None
) -> PinocchioState:
    """Pinocchio's coordinates of (N, J) joint positions, velocities, accelerations and the motion of the base.

    Raises:
        InputError: TYPE_MISMATCH when the shapes do not fit, NOT_FINITE, or UNSUPPORTED for a moving base under a model
            that was built with a fixed one.
    """
    joints = _checked_joints(model, position, velocity, acceleration, base)
    q, v, a = model.configuration(np.atleast_2d(np.asarray(position, dtype=np.float64))), joints[1], joints[2]
    if model.base == "fixed":
        return PinocchioState(q, v, a)
    base = base or _at_rest(len(q))
    quaternion = np.array([pin.Quaternion(rotation).coeffs() for rotation in base.rotation_world_base])
    omega, linear = base.angular_velocity_in_base, base.linear_velocity_in_base
    # A spatial acceleration's linear part is the classical one minus omega x v (Featherstone 2008, section 2.11).
    spatial = base.linear_acceleration_in_base - np.cross(omega, linear)
    return PinocchioState(
        np.hstack([base.translation_world_base, quaternion.reshape(-1, 4), q]),
        np.hstack([linear, omega, v]),
        np.hstack([spatial, base.angular_acceleration_in_base, a]),
    )


def sensor_motion(
    model: RobotModel,
    stamps: NDArray[np.int64],
    position: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    base: BaseMotion | None = None,
) -> SensorMotion:
    """The motion of the sensor frame; exact, and without gravity.

    Args:
        model: the robot; the world is the root link's frame unless the base moves.
        stamps: (N,) int64 ns.
        position, velocity, acceleration: (N, J) in the order of `model.joint_names`, see `RobotModel.order`.
        base: how the root link moves; None: it rests at the world's origin.

    Raises:
        InputError: as `state`.
    """
    if COMPILED:
        joints = _checked_joints(model, position, velocity, acceleration, base)
        rotation, _, vectors = _by_kernel(model, model.sensor_frame, joints, base)
    else:
        rotation, vectors = _by_pinocchio(model, pinocchio_state(model, position, velocity, acceleration, base))
    return SensorMotion(np.asarray(stamps, dtype=np.int64), rotation, vectors[0], vectors[1], vectors[2])


def _by_pinocchio(model: RobotModel, motion: PinocchioState) -> tuple[Array, Array]:
    """Rotation (N, 3, 3) of the sensor, and (3, N, 3) its angular velocity and acceleration, and its acceleration."""
    pinocchio, data, frame = model.pinocchio, model.pinocchio.createData(), model.frame_id(model.sensor_frame)
    n = len(motion.q)
    rotation, vectors = np.empty((n, 3, 3)), np.empty((3, n, 3))
    for i in range(n):
        pin.forwardKinematics(pinocchio, data, motion.q[i], motion.v[i], motion.a[i])
        rotation[i] = pin.updateFramePlacement(pinocchio, data, frame).rotation
        classical = pin.getFrameClassicalAcceleration(pinocchio, data, frame, pin.LOCAL)
        vectors[0, i] = pin.getFrameVelocity(pinocchio, data, frame, pin.LOCAL).angular
        vectors[1, i] = classical.angular
        vectors[2, i] = classical.linear
    return rotation, vectors


def frame_poses(
    model: RobotModel, position: ArrayLike, frame: str | None = None, base: BaseMotion | None = None
) -> tuple[Array, Array]:
    """Rotation (N, 3, 3) and translation (N, 3) m, world to `frame` (the sensor when None).

    Raises:
        InputError: FRAME_UNKNOWN, or as `state`.
    """
    zeros = np.zeros_like(np.atleast_2d(np.asarray(position, dtype=np.float64)))
    if COMPILED:
        joints = _checked_joints(model, position, zeros, zeros, base)
        return _by_kernel(model, frame or model.sensor_frame, joints, base)[:2]
    motion = pinocchio_state(model, position, zeros, zeros, base)
    pinocchio, data, index = model.pinocchio, model.pinocchio.createData(), model.frame_id(frame or model.sensor_frame)
    rotation, translation = np.empty((len(zeros), 3, 3)), np.empty((len(zeros), 3))
    for i in range(len(zeros)):
        pin.forwardKinematics(pinocchio, data, motion.q[i])
        pose = pin.updateFramePlacement(pinocchio, data, index)
        rotation[i], translation[i] = pose.rotation, pose.translation
    return rotation, translation


def motion_sigma(
    model: RobotModel,
    position: ArrayLike,
    velocity_sigma: ArrayLike,
    acceleration_sigma: ArrayLike,
    base_sigma: tuple[Array, Array] | None = None,
) -> tuple[Array, Array, Array]:
    """One-sigma noise of a sensor motion (angular velocity, angular acceleration, linear acceleration), each (N, 3).

    First order through the sensor's Jacobian, joints independent of each other; the part of the acceleration that is
    quadratic in the joint velocities is left out, which is small wherever these are known to a few per cent.

    Args:
        model: the robot.
        position: (N, J).
        velocity_sigma, acceleration_sigma: (N, J) as `differentiate` gives them.
        base_sigma: (N, 6) errors of the base's velocity and of its acceleration, linear and angular in its own axes;
            None: of a base that is at rest or fixed.
    """
    q = pinocchio_state(model, position, velocity_sigma, acceleration_sigma).q
    pinocchio, data, frame = model.pinocchio, model.pinocchio.createData(), model.frame_id(model.sensor_frame)
    rows = [pin.computeFrameJacobian(pinocchio, data, q_i, frame, pin.LOCAL) for q_i in q]
    jacobian = np.array(rows).reshape(len(q), 6, pinocchio.nv)  # pinocchio gives a row for a single joint
    own = jacobian.shape[2] - len(model.coupling)
    squared = (jacobian[:, :, own:] @ model.coupling) ** 2
    variance = [
        np.einsum("nij,nj->ni", squared, np.asarray(sigma, dtype=np.float64) ** 2)
        for sigma in (velocity_sigma, acceleration_sigma)
    ]
    if base_sigma is not None:
        for total, sigma in zip(variance, base_sigma, strict=True):
            total += np.einsum("nij,nj->ni", jacobian[:, :, :own] ** 2, sigma**2)
    return np.sqrt(variance[0][:, 3:]), np.sqrt(variance[1][:, 3:]), np.sqrt(variance[1][:, :3])


def _at_rest(n: int) -> BaseMotion:
    zeros = np.zeros((n, 3))
    return BaseMotion(np.tile(np.eye(3), (n, 1, 1)), zeros, zeros, zeros, zeros, zeros)
