"""How the hand moves with the joints, sample by sample, with exact derivatives (Pinocchio's)."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from poise.geometry import GRAVITY_IN_WORLD
from poise.robot import RobotModel, pinocchio_state
from poise.types import Array


@dataclass(frozen=True, eq=False)
class HandMotion:
    """Motion of the sensor in its own axes, N samples, J joints.

    Args:
        rotation: (N, 3, 3) sensor to world. position: (N, 3) m of its origin in the world.
        velocity, omega: (N, 3) m/s of its origin, rad/s.
        acceleration, alpha: (N, 3) m/s2 (without gravity), rad/s2.
    """

    rotation: Array
    position: Array
    velocity: Array
    omega: Array
    acceleration: Array
    alpha: Array

    @property
    def specific(self) -> Array:
        """(N, 3) gravity minus acceleration, m/s2."""
        return np.asarray(np.array(GRAVITY_IN_WORLD) @ self.rotation - self.acceleration)


@dataclass(frozen=True, eq=False)
class HandSlopes:
    """Derivatives (N, 3, J) of a hand motion by joint positions (`_q`), velocities (`_v`) and accelerations (`_a`).

    `moving_a` is d(-specific)/da and d(velocity)/dv, `turning_a` is d(alpha)/da and d(omega)/dv.
    """

    moving_a: Array
    turning_a: Array
    velocity_q: Array
    omega_q: Array
    specific_q: Array
    specific_v: Array
    alpha_q: Array
    alpha_v: Array


def hand_motion(model: RobotModel, position: Array, velocity: Array, acceleration: Array) -> HandMotion:
    """Where the sensor is and how it moves along joints (N, J)."""
    motion = pinocchio_state(model, position, velocity, acceleration)
    pinocchio, data, frame = model.pinocchio, model.pinocchio.createData(), model.frame_id(model.sensor_frame)
    n = len(motion.q)
    rotation, rows = np.empty((n, 3, 3)), np.empty((n, 5, 3))
    for i in range(n):
        pin.forwardKinematics(pinocchio, data, motion.q[i], motion.v[i], motion.a[i])
        pose = pin.updateFramePlacement(pinocchio, data, frame)
        twist = pin.getFrameVelocity(pinocchio, data, frame, pin.LOCAL)
        change = pin.getFrameClassicalAcceleration(pinocchio, data, frame, pin.LOCAL)
        rotation[i] = pose.rotation
        rows[i] = pose.translation, twist.linear, twist.angular, change.linear, change.angular
    return HandMotion(rotation, *rows.swapaxes(0, 1))


def hand_slopes(
    model: RobotModel, position: Array, velocity: Array, acceleration: Array
) -> tuple[HandMotion, HandSlopes]:
    """The motion along joints (N, J), and its derivatives."""
    motion = pinocchio_state(model, position, velocity, acceleration)
    pinocchio, data, frame = model.pinocchio, model.pinocchio.createData(), model.frame_id(model.sensor_frame)
    n, m = motion.v.shape
    rotation, rows, slopes = np.empty((n, 3, 3)), np.empty((n, 5, 3)), np.empty((n, 4, 6, m))
    for i in range(n):
        pin.computeForwardKinematicsDerivatives(pinocchio, data, motion.q[i], motion.v[i], motion.a[i])
        pose = pin.updateFramePlacement(pinocchio, data, frame)
        twist = pin.getFrameVelocity(pinocchio, data, frame, pin.LOCAL)
        change = pin.getFrameAcceleration(pinocchio, data, frame, pin.LOCAL)
        rotation[i] = pose.rotation
        rows[i] = pose.translation, twist.linear, twist.angular, change.linear, change.angular
        found = pin.getFrameAccelerationDerivatives(pinocchio, data, frame, pin.LOCAL)
        slopes[i] = [np.reshape(each, (6, m)) for each in found]  # pinocchio gives rows for a single joint
    v_q, a_q, a_v, a_a = (slopes @ model.coupling).swapaxes(0, 1)
    where, v, omega, spatial, alpha = rows.swapaxes(0, 1)
    moving, turning = a_a[:, :3], a_a[:, 3:]
    gravity = np.array(GRAVITY_IN_WORLD) @ rotation
    # A classical acceleration is the spatial one plus omega x v (Featherstone 2008, section 2.11).
    classical_q = a_q[:, :3] + _cross(omega, v_q[:, :3]) - _cross(v, v_q[:, 3:])
    classical_v = a_v[:, :3] + _cross(omega, moving) - _cross(v, turning)
    hand = HandMotion(rotation, where, v, omega, spatial + np.cross(omega, v), alpha)
    return hand, HandSlopes(
        moving_a=moving,
        turning_a=turning,
        velocity_q=v_q[:, :3],
        omega_q=v_q[:, 3:],
        specific_q=_cross(gravity, turning) - classical_q,
        specific_v=-classical_v,
        alpha_q=a_q[:, 3:],
        alpha_v=a_v[:, 3:],
    )


def _cross(vector: Array, matrix: Array) -> Array:
    """(N, 3, J) cross product of vectors (N, 3) with the columns of (N, 3, J)."""
    return np.asarray(np.cross(vector[:, :, None], matrix, axis=1))
