"""A simulated recording: the streams of a motion, with the sensors' noise."""

from dataclasses import dataclass

import numpy as np

from poise.recording import JointStream, WrenchStream
from poise.simulation.ideal_robot import IdealRobot
from poise.simulation.noise import JointNoise, NoisyJoints, NoisyWrench, WrenchNoise
from poise.simulation.trajectories import Trajectory


@dataclass(frozen=True)
class SimulatedRecording:
    """Joint states and wrench as recorded; each on its own clock."""

    joints: JointStream
    wrench: WrenchStream


def record(
    ideal: IdealRobot,
    trajectory: Trajectory,
    rng: np.random.Generator,
    wrench_noise: WrenchNoise | None = None,
    joint_noise: JointNoise | None = None,
    start: int = 0,
) -> SimulatedRecording:
    """Let the robot move along a trajectory and record it.

    Args:
        ideal: robot, payload, gravity.
        trajectory: of the model's joints.
        rng: source of randomness; equal seeds give equal recordings.
        wrench_noise, joint_noise: of the sensors; None: none.
        start: stamp of the first sample, ns.

    Raises:
        InputError: as `IdealRobot.simulate`.
    """
    joint_rng, wrench_rng = rng.spawn(2)
    joints = NoisyJoints(joint_noise or JointNoise(), joint_rng)
    sensor = NoisyWrench(wrench_noise or WrenchNoise(), wrench_rng)

    taken = _times(trajectory.duration, joints.noise.rate)
    truth = ideal.simulate(taken, trajectory.at(taken * np.float64(1e-9)))
    position, velocity, effort = joints.report(truth.joints.position, truth.joints.velocity, truth.effort)
    joint_stream = JointStream(start + joints.stamps(taken), ideal.model.joint_names, position, velocity, effort)

    taken = _times(trajectory.duration, sensor.noise.rate)
    wrench = ideal.simulate(taken, trajectory.at(taken * np.float64(1e-9))).wrench_in_sensor
    wrench_stream = WrenchStream(start + sensor.stamps(taken), sensor.report(wrench), ideal.model.sensor_frame)
    return SimulatedRecording(joint_stream, wrench_stream)


def _times(duration: float, rate: float) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """Sampling times, ns."""
    count = int(np.floor(duration * rate)) + 1
    return np.round(np.arange(count) * (1e9 / rate)).astype(np.int64)
