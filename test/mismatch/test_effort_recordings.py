"""Recordings with joint efforts: the tool and gravity in them, no payload, several recordings."""

from dataclasses import replace

import numpy as np
import pytest

from poise.inertia import InertialParameters
from poise.mismatch import NominalModel, diagnose, joined
from poise.mismatch.answer import effects_called
from poise.mismatch.reading import MeasuredStreams, ModelEffect, ReadRecording, read_streams, with_model_effects
from poise.mismatch.recorded import joint_torques, shown, wrench_of_torques
from poise.robot import RobotModel, find_urdf, read_urdf
from poise.simulation import FourierTrajectory, IdealRobot, WrenchNoise, record

URDF = read_urdf(find_urdf("ridgeback_ur10"))
ROBOT = RobotModel.from_urdf(URDF, "ft_sensor")
PHI = InertialParameters(2.0, np.array([0.0, 0.01, 0.1]), 0.01 * np.eye(3)).phi
NOISE = WrenchNoise(rate=100.0, force=0.1, torque=0.005)


def read(
    model: NominalModel,
    seed: int = 2,
    phi: np.ndarray = PHI,
    seconds: float = 8.0,
    damping: np.ndarray | float = 0.0,
    dry: np.ndarray | float = 0.0,
    *,
    efforts_alone: bool = False,
) -> ReadRecording:
    """A recording of the ideal robot with effort noise, damped joints and dry friction, read."""
    motion = FourierTrajectory.random(ROBOT, np.random.default_rng(seed), duration=seconds, speed=0.3)
    ideal = IdealRobot(ROBOT, phi, [0.0, 0.0, -(model.gravity or 9.80665)], model.tool_in_wrench)
    made = record(ideal, motion, np.random.default_rng(seed), NOISE)
    noise = np.random.default_rng(seed).normal(size=made.joints.effort.shape) * 0.1
    friction = damping * made.joints.velocity + dry * np.tanh(made.joints.velocity / 0.03)
    joints = replace(made.joints, effort=made.joints.effort + noise + friction)
    streams = MeasuredStreams("test", None if efforts_alone else made.wrench, lambda _: joints, None, lambda: URDF)
    return read_streams(streams, model)


@pytest.mark.parametrize("tool", [False, True])
@pytest.mark.parametrize("gravity", [None, 1.62])
def test_efforts_contain_the_tool_once_and_the_gravity_of_the_model(tool, gravity):
    model = NominalModel(sensor_frame="ft_sensor", phi=PHI, tool_in_wrench=tool, gravity=gravity)
    effort = read(model).recorded.effort
    assert effort is not None
    error = effort.measured - effort.prediction
    assert np.abs(error.mean(axis=0)).max() < 0.05
    assert error.std() < 0.15


def test_a_hand_without_a_payload_is_diagnosed_from_wrench_and_efforts():
    reading = read(NominalModel(sensor_frame="ft_sensor", phi=np.zeros(10)), phi=np.zeros(10))
    found = diagnose(reading.recorded, reading.model, library=effects_called(["sensor_bias", "viscous_friction"]))
    assert {each.problem.signal for each in found.examinations} == {"wrench", "effort"}
    assert not found.findings


def test_the_last_of_two_recordings_with_efforts_is_held_out_in_both_signals():
    model = NominalModel(sensor_frame="ft_sensor", phi=PHI)
    parts = [read(model, seed).recorded for seed in (2, 3)]
    whole, last = joined(parts)
    found = diagnose(whole, model, last, effects_called(["sensor_bias", "viscous_friction"]))
    assert parts[1].effort is not None
    lengths = {each.problem.signal: int(each.held_out.sum()) for each in found.examinations}
    assert lengths == {"wrench": len(parts[1]), "effort": len(parts[1].effort.seconds)}
    assert not found.findings


def test_no_fit_leaves_the_physical_bounds_of_a_friction():
    """An elbow that drives itself is no friction: its damping ends at zero, that of the shoulder is found."""
    model = NominalModel(sensor_frame="ft_sensor", phi=PHI)
    damping = np.zeros(len(ROBOT.joint_names))
    shoulder, elbow = (ROBOT.joint_names.index(name) for name in ("shoulder_lift_joint", "elbow_joint"))
    damping[[shoulder, elbow]] = 30.0, -8.0
    reading = read(model, damping=damping)
    found = diagnose(reading.recorded, reading.model, library=effects_called(["viscous_friction"]))
    (named,) = (each for each in found.findings if each.effect.name == "viscous_friction")
    assert min(named.values.values()) >= 0.0
    assert reading.recorded.effort is not None
    numbers = [
        f"damping_{reading.recorded.effort.names.index(name) + 1}" for name in ("shoulder_lift_joint", "elbow_joint")
    ]
    assert named.values[numbers[0]] == pytest.approx(30.0, rel=0.1)
    assert named.values[numbers[1]] == 0.0


ARM = np.array([not name.startswith("ridgeback") and "base" not in name for name in ROBOT.joint_names])
"""Joints with friction."""


def test_friction_and_an_undeclared_load_are_found_together_in_efforts_alone():
    """Coulomb friction with a transition of 30 mrad/s is no stribeck friction, and the load is no link error."""
    none = np.zeros(10)
    model = NominalModel(sensor_frame="ft_sensor", phi=none)
    reading = read(model, phi=PHI, damping=5.0 * ARM, dry=4.0 * ARM, efforts_alone=True)
    library = ["viscous_friction", "coulomb_friction", "stribeck_friction", "payload_parameters", "link_parameters"]
    found = diagnose(reading.recorded, reading.model, library=effects_called(library))
    named = {each.effect.name: each for each in found.findings}
    assert set(named) == {"viscous_friction", "coulomb_friction", "payload_parameters"}
    assert named["payload_parameters"].parameters["mass"].value == pytest.approx(PHI[0], rel=0.05)
    assert named["coulomb_friction"].parameters["transition"].value == pytest.approx(0.03, rel=0.2)
    assert found.main.proof.augmented < 1.2
    # What was found is part of the nominal model of a second diagnosis, which finds nothing more.
    again = diagnose(reading.recorded, found.augmented, library=effects_called(library))
    assert not again.findings
    assert again.main.proof.nominal < 1.2


def test_a_model_of_an_earlier_version_has_the_fixed_transition():
    reading = read(NominalModel(sensor_frame="ft_sensor", phi=PHI))
    effort = reading.recorded.effort
    assert effort is not None
    joints = range(1, len(effort.names) + 1)
    old = ModelEffect("coulomb_friction", {f"torque_{i}": 2.0 for i in joints}, np.zeros((len(joints), len(joints))))
    made = with_model_effects(reading.recorded, [old]).effort
    assert made is not None
    np.testing.assert_allclose(made.prediction - effort.rigid, 2.0 * np.tanh(effort.velocity / 0.005), atol=1e-9)


def test_a_wrench_is_recovered_from_the_torques_that_balance_it():
    recorded = read(NominalModel(sensor_frame="ft_sensor", phi=PHI)).recorded
    wrench = np.tile([3.0, -2.0, 4.0, 0.1, 0.2, -0.1], (len(recorded), 1))
    torques = joint_torques(recorded, wrench[:, :, None])[:, :, 0]
    assert np.median(np.abs(wrench_of_torques(recorded, torques) - wrench)) < 0.05
    assert shown(recorded, wrench) is wrench
    alone = replace(recorded, wrench=np.full_like(recorded.wrench, np.nan))
    np.testing.assert_allclose(shown(alone, wrench), wrench_of_torques(alone, torques), atol=0.01)  # two clocks
