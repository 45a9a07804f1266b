"""The simulation with the effects of a diagnosis along a motion: wrench and joint states."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from poise.mismatch.reading import (
    NominalModel,
    effort_track,
    recorded_from_motion,
    with_model_effects,
)
from poise.mismatch.recorded import EffortTrack, RecordedMotion
from poise.recording import JointStream, Stream, WrenchStream
from poise.robot import RobotModel
from poise.simulation import Trajectory

_NOISE = (0.1, 0.005)
"""N and N m: noise of an FT-300, for a model that states none (thesis table 3.2, moderate)."""
_EFFORT_NOISE = 0.1
"""N m, of motor currents (as `fake_robot` has it)."""
_NEAR = 0.6
"""Periods of the compared efforts around one of them in which joint states are simulated."""


@dataclass(frozen=True, eq=False)
class SimulatedRun:
    """A simulated motion.

    Args:
        nominal: the motion without the model's effects.
        recorded: the motion with them.
        wrench: of the sensor; None along a recording without one.
        joints: joint states with efforts; None when the simulation does not change them.
    """

    nominal: RecordedMotion
    recorded: RecordedMotion
    wrench: WrenchStream | None
    joints: JointStream | None

    @property
    def streams(self) -> Mapping[str, Stream]:
        """By topic."""
        made = {"wrench": self.wrench, "joint_states": self.joints}
        return {topic: stream for topic, stream in made.items() if stream is not None}


def run_recorded(
    nominal: RecordedMotion, joints: JointStream | None, model: NominalModel, rng: np.random.Generator | None = None
) -> SimulatedRun:
    """Along the motion of a recording.

    Args:
        nominal: the recording as read.
        joints: its joint states; where it holds efforts, they are replaced by the simulated ones.
        model: with its effects; events are repeated.
        rng: adds the model's white noise to the wrench, and that of currents to efforts; None: none.
    """
    recorded = with_model_effects(nominal, model.effects, events=True)
    simulated = None
    if recorded.effort is not None and joints is not None:
        simulated = _at_states(recorded, recorded.effort, joints)
    wrench = _wrench(recorded, model, rng) if nominal.has("wrench") else None
    return SimulatedRun(nominal, recorded, wrench, simulated if simulated is None else _noisy(simulated, rng))


def _at_states(recorded: RecordedMotion, effort: EffortTrack, joints: JointStream) -> JointStream:
    """The joint states of a recording with simulated efforts, where these are known: not at its ends, not in gaps."""
    seconds = (joints.stamps - recorded.start) * 1e-9
    after = np.clip(np.searchsorted(effort.seconds, seconds), 1, len(effort.seconds) - 1)
    near = np.minimum(np.abs(seconds - effort.seconds[after - 1]), np.abs(seconds - effort.seconds[after]))
    rows = near < _NEAR * effort.period
    made = np.full((int(rows.sum()), len(joints.names)), np.nan)
    for name, values in zip(effort.names, effort.prediction.T, strict=True):
        made[:, joints.names.index(name)] = np.interp(seconds[rows], effort.seconds, values)
    return replace(joints.select(rows), effort=made)


def run_planned(
    robot: RobotModel,
    trajectory: Trajectory,
    model: NominalModel,
    rng: np.random.Generator | None = None,
    *,
    wrench_rate: float = 100.0,
    joint_rate: float = 125.0,
) -> SimulatedRun:
    """Along a trajectory of a robot's joints.

    Args:
        robot: fixed base.
        trajectory: its joints' motion.
        model: as in `run_recorded`; without a payload the hand is empty.
        rng: likewise.
        wrench_rate, joint_rate: Hz.
    """
    phi = np.zeros(10) if model.phi is None else model.phi
    gravity = model.gravity_or_standard
    sampled = np.arange(int(trajectory.duration * joint_rate) + 1) / joint_rate
    joints = trajectory.at(sampled)
    effort = effort_track(robot, sampled, joints, np.zeros(joints.position.shape), phi, gravity=gravity)
    seconds = np.arange(int(trajectory.duration * wrench_rate) + 1) / wrench_rate
    nominal = recorded_from_motion(
        robot,
        seconds,
        trajectory.at(seconds),
        phi + robot.load_in_sensor if model.tool_in_wrench else phi,
        gravity=gravity,
        effort=effort if effort.names else None,
    )
    recorded = with_model_effects(nominal, model.effects, events=True)
    simulated = np.full(joints.position.shape, np.nan)
    if recorded.effort is not None:
        simulated[:, robot.base_joints :] = recorded.effort.prediction
    stamps = np.round(sampled * 1e9).astype(np.int64)
    stream = JointStream(stamps, robot.joint_names, joints.position, joints.velocity, simulated)
    settled = replace(model, sensor_frame=robot.sensor_frame)
    wrench = _wrench(recorded, settled, rng)
    return SimulatedRun(nominal, recorded, wrench, _noisy(stream, rng))


def _noisy(joints: JointStream, rng: np.random.Generator | None) -> JointStream:
    if rng is None:
        return joints
    return replace(joints, effort=joints.effort + rng.normal(size=joints.effort.shape) * _EFFORT_NOISE)


def _wrench(recorded: RecordedMotion, model: NominalModel, rng: np.random.Generator | None) -> WrenchStream:
    wrench = np.array(recorded.prediction)
    if rng is not None:
        given = (model.noise_force or _NOISE[0], model.noise_torque or _NOISE[1])
        wrench += rng.normal(size=wrench.shape) * np.repeat(given, 3)
    stamps = recorded.start + np.round(recorded.seconds * 1e9).astype(np.int64)
    if stamps[0] > recorded.start:
        # The seconds of events count from the first wrench, even if the motion was unknown there.
        stamps, wrench = np.insert(stamps, 0, recorded.start), np.insert(wrench, 0, wrench[0], axis=0)
    return WrenchStream(stamps, wrench, model.sensor_frame or "ft_sensor")
