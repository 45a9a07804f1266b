"""From a recording to the sensor's motion and how well it is known: joint states, or poses from tf."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.robot.differentiation import Derivatives, differentiate, differentiate_rotations
from poise.robot.kinematics import motion_sigma, sensor_motion
from poise.robot.model import RobotModel
from poise.robot.motion import SensorMotion
from poise.robot.odometry import MeasuredBase
from poise.robot.turns import without_turns
from poise.types import Array


@dataclass(frozen=True)
class MeasuredMotion:
    """A sensor's motion with the one-sigma errors of its components, each (N, 3)."""

    motion: SensorMotion
    angular_velocity_sigma: Array
    angular_acceleration_sigma: Array
    linear_acceleration_sigma: Array


def motion_from_joints(
    model: RobotModel,
    stamps: ArrayLike,
    names: Sequence[str],
    position: ArrayLike,
    velocity: ArrayLike | None = None,
    knot_spacing: float | None = None,
    within: tuple[int, int] | None = None,
    errors: bool = True,
) -> MeasuredMotion:
    """The motion of the sensor from joint states, for a base that rests (or whose joints are in the URDF).

    Args:
        model: the robot.
        stamps: (N,) ns.
        names: (K) as in the joint states; more than the model's are fine, fewer are not.
        position: (N, K) rad or m.
        velocity: (N, K) where there is one; NaN columns are left out.
        knot_spacing: s; None: cross-validated, see `differentiate`.
        within: ns, first and last stamp that are answered; None: all.
        errors: whether the sigmas are wanted; else they are NaN.

    Returns:
        The samples that have derivatives; stretches of fewer than 12 samples between gaps are left out.

    Raises:
        InputError: as `RobotModel.order`, `differentiate` and `sensor_motion`.
    """
    (ordered,) = model.order(names, position)
    ordered = without_turns(np.asarray(stamps) * 1e-9, ordered)
    rates = None if velocity is None else model.order(names, velocity)[0]
    return motion_from_derivatives(
        model, differentiate(stamps, ordered, rates, knot_spacing=knot_spacing, within=within, errors=errors)
    )


def motion_from_derivatives(model: RobotModel, joints: Derivatives, base: MeasuredBase | None = None) -> MeasuredMotion:
    """The motion of the sensor from differentiated joint positions, ordered as the model's joints.

    Args:
        model: the robot; floating where the base moves.
        joints: (N, J).
        base: the motion of the root link at the joints' stamps; None: it rests at the world's origin.
    """
    known = np.isfinite(joints.acceleration).all(axis=1)
    if base is not None:
        known = np.asarray(known & base.known)
    position = joints.position[known]
    motion = sensor_motion(
        model,
        joints.stamps[known],
        position,
        joints.velocity[known],
        joints.acceleration[known],
        None if base is None else base.motion.select(np.asarray(known)),
    )
    sigmas = joints.velocity_sigma[known], joints.acceleration_sigma[known]
    errors = bool(np.isfinite(sigmas[1]).all())
    base_sigma = None if base is None else (base.velocity_sigma[known], base.acceleration_sigma[known])
    nothing = np.full((3, len(position), 3), np.nan)
    sigma = motion_sigma(model, position, *sigmas, base_sigma) if errors else nothing
    return MeasuredMotion(motion, *sigma)


def motion_from_poses(
    stamps: ArrayLike,
    rotation_world_sensor: ArrayLike,
    translation_world_sensor: ArrayLike,
    knot_spacing: float | None = None,
    within: tuple[int, int] | None = None,
    errors: bool = True,
) -> MeasuredMotion:
    """The motion of the sensor from its poses, as from tf.

    Args:
        stamps: (N,) ns.
        rotation_world_sensor: (N, 3, 3).
        translation_world_sensor: (N, 3) m. Where only attitudes were recorded and these are all zero, the linear
            acceleration comes out as zero: that is an assumption, not a measurement.
        knot_spacing: s; None: cross-validated.
        within: ns, first and last stamp that are answered; None: all.
        errors: whether the sigmas are wanted; else they are NaN.

    Raises:
        InputError: as `differentiate_rotations`.
    """
    turning = differentiate_rotations(
        stamps, rotation_world_sensor, knot_spacing=knot_spacing, within=within, errors=errors
    )
    moving = differentiate(stamps, translation_world_sensor, knot_spacing=knot_spacing, within=within, errors=errors)
    known = np.isfinite(turning.angular_acceleration).all(axis=1)
    rotation = turning.rotation[known]
    motion = SensorMotion(
        turning.stamps[known],
        rotation,
        turning.angular_velocity[known],
        turning.angular_acceleration[known],
        np.einsum("nji,nj->ni", rotation, moving.acceleration[known]),
    )
    linear = np.sqrt(np.einsum("nji,nj->ni", rotation**2, moving.acceleration_sigma[known] ** 2))
    ones = np.ones(3)
    return MeasuredMotion(
        motion,
        turning.angular_velocity_sigma[known, None] * ones,
        turning.angular_acceleration_sigma[known, None] * ones,
        linear,
    )
