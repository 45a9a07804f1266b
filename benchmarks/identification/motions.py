"""Motions of a UR10's wrist: thesis eq. 3.14, with exact velocities and accelerations."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from poise.robot import SensorMotion
from poise.types import Array

AMPLITUDE = np.deg2rad(45.0)
# Hz. Eq. 3.14 prints sin(2 pi f t / 240) and calls t the time; 240 is the number of samples a second (of the
# simulator), so that t counts samples. In seconds, as here, the divisor goes.
FREQUENCIES = np.array([0.1, 0.13, 0.16])
DURATION = 35.0  # s, of the thesis' motion; shorter ones are pieces of it

# Joints 4 to 6 of a UR10 (Universal Robots, DH parameters): rotation into the next link and its length, m.
TURNS = Rotation.from_euler("x", [[90], [-90], [0]], degrees=True).as_matrix()
OFFSETS = np.array([[0.0, 0.0, 0.163941], [0.0, 0.0, 0.1157], [0.0, 0.0, 0.0922]])
SENSOR_ON_FLANGE = np.array([0.0, 0.0, 0.0375])  # m, the height of a Robotiq FT-300
# The axis of joint 4 lies level, as it does on this robot for all positions of the first three joints.
ROTATION_WORLD_WRIST = Rotation.from_euler("x", 90, degrees=True).as_matrix()


@dataclass(frozen=True, eq=False)
class WristMotion:
    """Three joints that swing: angle_n(t) = start_n + 45 deg sin(2 pi s f_n t + phase_n).

    Args:
        start: (3,) rad, where the joints are when the sines are zero.
        phase: (3,) rad.
        speed_up: s, how many times faster than in the thesis' slowest motion.
    """

    start: Array
    phase: Array
    speed_up: float = 1.0

    def at(self, seconds: Array) -> SensorMotion:
        """Where the sensor is and how it moves at these times (N,), which become the stamps."""
        angular_frequency = 2 * np.pi * FREQUENCIES * self.speed_up
        argument = angular_frequency * seconds[:, None] + self.phase
        angle = self.start + AMPLITUDE * np.sin(argument)
        rate = AMPLITUDE * angular_frequency * np.cos(argument)
        acceleration = -AMPLITUDE * angular_frequency**2 * np.sin(argument)
        n = len(seconds)
        rotation = np.broadcast_to(ROTATION_WORLD_WRIST, (n, 3, 3))
        omega, alpha, linear = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
        for joint in range(3):
            axis = rotation[:, :, 2]
            alpha = alpha + axis * acceleration[:, joint, None] + np.cross(omega, axis * rate[:, joint, None])
            omega = omega + axis * rate[:, joint, None]
            # In DH's order: along the joint's own axis first, then the turn into the next link.
            rotation = rotation @ Rotation.from_rotvec(angle[:, joint, None] * [0.0, 0.0, 1.0]).as_matrix()
            arm = rotation @ OFFSETS[joint]
            rotation = rotation @ TURNS[joint]
            if joint == 2:
                arm = arm + rotation @ SENSOR_ON_FLANGE
            linear = linear + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
        return SensorMotion(
            stamps=np.round(seconds * 1e9).astype(np.int64),
            rotation_world_sensor=rotation,
            angular_velocity_in_sensor=np.einsum("nji,nj->ni", rotation, omega),
            angular_acceleration_in_sensor=np.einsum("nji,nj->ni", rotation, alpha),
            linear_acceleration_in_sensor=np.einsum("nji,nj->ni", rotation, linear),
        )


def wrist_motion(rng: np.random.Generator, mean_speed: float, seconds: Array) -> Callable[[Array], SensorMotion]:
    """A random piece of the thesis' motion, played at a mean angular speed [rad/s] over the given times (N,)."""
    start = rng.uniform(-np.pi, np.pi, 3)
    phase = 2 * np.pi * FREQUENCIES * rng.uniform(0.0, DURATION)

    def excess(log_speed_up: float) -> float:
        motion = WristMotion(start, phase, float(np.exp(log_speed_up))).at(seconds)
        return float(np.linalg.norm(motion.angular_velocity_in_sensor, axis=1).mean() - mean_speed)

    speed_up = float(np.exp(brentq(excess, np.log(0.01), np.log(100.0), xtol=1e-9, maxiter=100)))
    return WristMotion(start, phase, speed_up).at
