"""From a URDF and joint states to how the sensor moved.

- `motion`: `SensorMotion`, what every wrench model needs to know.
- `model`: `RobotModel`, a URDF read safely, with the sensor's frame.
- `kinematics`: joint positions, velocities, accelerations -> `SensorMotion`.
- `differentiation`: positions or rotations -> velocities and accelerations, with honest noise.
"""

from poise.robot.motion import GRAVITY_IN_WORLD, STANDARD_GRAVITY, SensorMotion

__all__ = ["GRAVITY_IN_WORLD", "STANDARD_GRAVITY", "SensorMotion"]
