"""Ideal robots and their sensors: the reference for recordings, and the dynamics of fake robots.

- `trajectories`: commanded motions of joints.
- `world`: robot, payload and gravity -> joint efforts and the wrench on the sensor.
- `noise`: published noise of sensors.
- `recorded`: the simulated measurements in the form of a recording.
- `models`: simulators' own models in; `rollout`: free runs of them. Each has a face of its own.
"""

from poise.simulation.ideal_robot import IdealRobot, Truth
from poise.simulation.noise import WRENCH_NOISE, JointNoise, NoisyJoints, NoisyWrench, WrenchNoise, wrench_noise
from poise.simulation.recorded import SimulatedRecording, record
from poise.simulation.trajectories import (
    FourierTrajectory,
    JointMotion,
    SplineTrajectory,
    Trajectory,
    WaypointTrajectory,
    check_limits,
    home,
)
from poise.simulation.trajectory_files import read_trajectory

__all__ = [
    "WRENCH_NOISE",
    "FourierTrajectory",
    "IdealRobot",
    "JointMotion",
    "JointNoise",
    "NoisyJoints",
    "NoisyWrench",
    "SimulatedRecording",
    "SplineTrajectory",
    "Trajectory",
    "Truth",
    "WaypointTrajectory",
    "WrenchNoise",
    "check_limits",
    "home",
    "read_trajectory",
    "record",
    "wrench_noise",
]
