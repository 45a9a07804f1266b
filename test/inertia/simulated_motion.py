"""An FR3 that swings or steps from pose to pose with a load, as the streams that a recording would hold."""

from dataclasses import dataclass

import numpy as np

from poise.inertia import InertialParameters
from poise.inertia.model import regressor
from poise.recording import JointStream, PoseStream, WrenchStream
from poise.robot import RobotModel, frame_poses, sensor_motion
from poise.types import Array

GRAVITY = 9.80665
BIAS = np.array([5.0, -3.0, 8.0, 0.2, -0.1, 0.3])
LOAD = InertialParameters(
    1.2, np.array([0.02, -0.03, 0.08]), np.array([[6, 0.5, 0.3], [0.5, 5, -0.4], [0.3, -0.4, 3]]) * 1e-3
)
HOME = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that was measured, and the robot it was measured on."""

    model: RobotModel
    joints: JointStream
    poses: PoseStream
    wrench: WrenchStream


def fr3() -> RobotModel:
    return RobotModel.from_file("fr3")


def swing(seconds: Array) -> tuple[Array, Array, Array]:
    """Every joint swings at its own pace: positions, velocities, accelerations (N, 7)."""
    pace = 2 * np.pi * np.array([0.3, 0.35, 0.4, 0.45, 0.55, 0.65, 0.75])
    amplitude = np.array([0.3, 0.25, 0.3, 0.3, 0.5, 0.6, 0.8])
    phase = seconds[:, None] * pace + np.arange(7)
    return HOME + amplitude * np.sin(phase), amplitude * pace * np.cos(phase), -amplitude * pace**2 * np.sin(phase)


def steps(seconds: Array, hold: float = 1.0, travel: float = 0.5) -> tuple[Array, Array, Array]:
    """Rest in one pose after another, quintic in between."""
    period = hold + travel
    number = np.floor(seconds / period).astype(int)
    targets = HOME + np.random.default_rng(5).uniform(-0.9, 0.9, (number.max() + 2, 7))
    s = np.clip((seconds - number * period - hold) / travel, 0.0, 1.0)[:, None]
    way = targets[number + 1] - targets[number]
    return (
        targets[number] + way * (10 * s**3 - 15 * s**4 + 6 * s**5),
        way * (30 * s**2 - 60 * s**3 + 30 * s**4) / travel,
        way * (60 * s - 180 * s**2 + 120 * s**3) / travel**2,
    )


def record(
    trajectory,
    duration: float,
    *,
    rng: np.random.Generator,
    load: InertialParameters = LOAD,
    noise: tuple[float, float] = (0.05, 0.002),
    joint_noise: float = 2e-6,
    joint_rate: float = 100.0,
    wrench_rate: float = 500.0,
) -> Scene:
    """Play a trajectory and measure: joint positions, the poses from them, and wrenches, all with white noise."""
    model = fr3()
    start = 1_700_000_000_000_000_000
    seconds = np.arange(0, duration, 1 / joint_rate)
    position = trajectory(seconds)[0] + rng.normal(0.0, joint_noise, (len(seconds), 7))
    stamps = start + np.round(seconds * 1e9).astype(np.int64)
    unknown = np.full(position.shape, np.nan)
    rotation, translation = frame_poses(model, position)

    at = np.arange(0.0007, duration, 1 / wrench_rate)
    wrench_stamps = start + np.round(at * 1e9).astype(np.int64)
    motion = sensor_motion(model, wrench_stamps, *trajectory(at))
    specific = motion.gravity_in_sensor([0, 0, -GRAVITY]) - motion.linear_acceleration_in_sensor
    wrench = regressor(specific, motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor) @ load.phi
    wrench = wrench + BIAS + rng.normal(size=wrench.shape) * np.repeat(noise, 3)
    return Scene(
        model,
        JointStream(stamps, model.joint_names, position, unknown, unknown),
        PoseStream(stamps, rotation, translation, model.base_frame, model.sensor_frame),
        WrenchStream(wrench_stamps, wrench, model.sensor_frame),
    )
