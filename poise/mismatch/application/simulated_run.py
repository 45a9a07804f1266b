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
from poise.mismatch.recorded import RecordedMotion
from poise.recording import JointStream, Stream, WrenchStream
from poise.robot import RobotModel
from poise.simulation import Trajectory

_NOISE = (0.1, 0.005)
"""N and N m: noise of an FT-300, for a model that states none (thesis table 3.2, moderate)."""
_EFFORT_NOISE = 0.1
"""N m, of motor currents (as `fake_robot` has it)."""
_ROUNDED = 1000
"""ns, rounding error of a stamp after conversion to seconds and back."""


@dataclass(frozen=True, eq=False)
class SimulatedRun:
    """A simulated motion.

    Args:
        nominal: the motion without the model's effects.
        recorded: the motion with them.
        wrench: of the sensor.
        joints: joint states with efforts; None when the simulation does not change them.
    """

    nominal: RecordedMotion
    recorded: RecordedMotion
    wrench: WrenchStream
    joints: JointStream | None

    @property
    def streams(self) -> Mapping[str, Stream]:
        """By topic."""
        made: dict[str, Stream] = {"wrench": self.wrench}
        return made if self.joints is None else {**made, "joint_states": self.joints}


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
        # The samples of the recording, without its ends, where no smoothed motion exists.
        stamps = recorded.start + np.round(recorded.effort.seconds * 1e9).astype(np.int64)
        rows, first = np.unique(np.searchsorted(joints.stamps, stamps - _ROUNDED), return_index=True)
        effort = np.full((len(rows), len(joints.names)), np.nan)
        effort[:, [joints.names.index(name) for name in recorded.effort.names]] = recorded.effort.prediction[first]
        simulated = replace(joints.select(rows), effort=effort)
    wrench = _wrench(recorded, model, rng)
    return SimulatedRun(nominal, recorded, wrench, simulated if simulated is None else _noisy(simulated, rng))


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
