"""From a URDF and joint states to how the sensor moved.

- `motion`: `SensorMotion`, what every wrench model needs to know.
- `urdf`, `model`: `RobotModel`, a URDF read safely, with the sensor's frame and what hangs beyond it.
- `kinematics`: joint positions, velocities, accelerations (and a moving base) -> `SensorMotion`.
- `splines`, `differentiation`, `sliding`: positions or rotations -> rates and accelerations, with honest noise.
- `measured`: a recording's joint states or poses -> `SensorMotion` with its noise.
- `models/`: URDFs of an FR3, an xArm7 and a UR10 on a Ridgeback.
"""

from poise.robot.differentiation import Derivatives, RotationDerivatives, differentiate, differentiate_rotations
from poise.robot.kinematics import BaseMotion, frame_poses, motion_sigma, sensor_motion
from poise.robot.measured import MeasuredMotion, motion_from_derivatives, motion_from_joints, motion_from_poses
from poise.robot.model import RobotModel, inertia_of, phi_of
from poise.robot.motion import GRAVITY_IN_WORLD, STANDARD_GRAVITY, SensorMotion
from poise.robot.sliding import SlidingDifferentiator

__all__ = [
    "GRAVITY_IN_WORLD",
    "STANDARD_GRAVITY",
    "BaseMotion",
    "Derivatives",
    "MeasuredMotion",
    "RobotModel",
    "RotationDerivatives",
    "SensorMotion",
    "SlidingDifferentiator",
    "differentiate",
    "differentiate_rotations",
    "frame_poses",
    "inertia_of",
    "motion_from_derivatives",
    "motion_from_joints",
    "motion_from_poses",
    "motion_sigma",
    "phi_of",
    "sensor_motion",
]
