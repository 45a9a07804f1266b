"""Joints that rest in dry friction: what it carries there depends on how they stopped, and is no other effect."""

from dataclasses import replace

import numpy as np
import pytest
from field_robots import ARM, read

from poise.commands.mismatch_answer import as_json
from poise.mismatch.answer import diagnose
from poise.mismatch.inference import beside_stuck_joints, effort_problem
from poise.mismatch.inference.standstill import standing
from poise.mismatch.reading import ModelEffect, ReadRecording
from poise.recording import JointStream
from poise.robot import RobotModel
from poise.simulation import IdealRobot, JointMotion
from poise.types import Array

MOVE, HOLD, PLACES, RATE = 1.2, 0.8, 9, 125.0


def moves(rng: np.random.Generator, joints: int) -> JointMotion:
    """From place to place with minimum jerk, and a hold at each place."""
    places = rng.uniform(-1.2, 1.2, size=(PLACES, joints))
    at = np.arange(int((PLACES - 1) * (MOVE + HOLD) * RATE)) / RATE
    number = np.minimum((at / (MOVE + HOLD)).astype(int), PLACES - 2)
    x = np.clip((at - number * (MOVE + HOLD)) / MOVE, 0.0, 1.0)[:, None]
    stride, first = (places[1:] - places[:-1])[number], places[number]
    rise = 10 * x**3 - 15 * x**4 + 6 * x**5, 30 * x**2 - 60 * x**3 + 30 * x**4, 60 * x - 180 * x**2 + 120 * x**3
    position, velocity, acceleration = (s * stride / MOVE**k for k, s in enumerate(rise))
    return JointMotion(first + position, velocity, acceleration)


def friction(rng: np.random.Generator, velocity: Array, dry: Array, stiction: float) -> Array:
    """(N, J) dry friction, and at each hold a load of any size up to it."""
    size = dry * (1.0 + stiction * np.exp(-((velocity / 0.08) ** 2)))
    hold = (np.arange(len(velocity)) / RATE / (MOVE + HOLD)).astype(int)
    carried = rng.uniform(-1.0, 1.0, size=(hold.max() + 1, len(dry)))[hold]
    return np.asarray(np.where(np.abs(velocity) < 1e-6, size * carried, size * np.sign(velocity)))


def recorded(dry: float, stiction: float = 0.0, seed: int = 3) -> ReadRecording:
    robot, rng = RobotModel.from_urdf(ARM, "link_3"), np.random.default_rng(seed)
    moved = moves(rng, 3)
    effort = IdealRobot(robot, np.zeros(10)).effort(moved)
    effort = effort + friction(rng, moved.velocity, dry * np.array([2.0, 1.0, 0.3]), stiction)
    effort = effort + 0.05 * rng.normal(size=effort.shape)
    position = moved.position + 1e-5 * rng.normal(size=effort.shape)
    stamps = np.round((np.arange(len(effort)) / RATE + 100.0) * 1e9).astype(np.int64)
    return read(JointStream(stamps, robot.joint_names, position, moved.velocity, effort), ARM)


def test_holds_are_found_and_reversals_are_not() -> None:
    track = recorded(0.0).recorded.effort
    assert track is not None
    since = np.mod(track.seconds, MOVE + HOLD)
    hold = (since > MOVE + 0.1) & (since < MOVE + HOLD - 0.1)
    still = standing(track)
    assert still[hold].mean() > 0.95
    assert still[(since > 0.2) & (since < MOVE - 0.2)].mean() < 0.02


@pytest.mark.parametrize(("stiction", "name"), [(0.0, "coulomb_friction"), (1.0, "stribeck_friction")])
def test_what_friction_carries_at_rest_is_no_effect(stiction: float, name: str) -> None:
    case = recorded(2.0, stiction)
    found = diagnose(case.recorded, case.model)
    (named,) = found.findings
    assert named.effect.name == name
    sizes = [named.values[f"torque_{i}"] for i in (1, 2, 3)]
    assert sizes == pytest.approx([4.0, 2.0, 0.6], rel=0.1)
    assert found.verdict == "named" or stiction  # beside the onset of a motion, stiction leaves an error
    (track,) = (each.problem.recorded.effort for each in found.examinations)
    assert track is not None
    assert track.stuck is not None
    assert 0.2 < track.stuck.mean() < 0.5
    assert found.at_rest == dict(zip(track.names, track.stuck.mean(axis=0).tolist(), strict=True))
    assert all(name in found.rest_sentence for name in track.names)
    assert as_json(found, [case])["fit"]["at_rest"] == found.at_rest


def test_without_dry_friction_a_hold_shows_the_load() -> None:
    case = recorded(0.0)
    problem = effort_problem(case.recorded, case.model)
    assert beside_stuck_joints(problem, None) is problem
    found = diagnose(case.recorded, case.model)
    assert found.verdict == "none"
    assert found.at_rest == {}
    assert found.rest_sentence == ""


def test_friction_of_the_model_holds_joints_too_and_its_reversals_are_not_known() -> None:
    """Friction in model.yaml, as it is: what it carries at rest was `coulomb_friction`."""
    case = recorded(2.0)
    torques = {f"torque_{i}": size for i, size in enumerate((4.0, 2.0, 0.6), start=1)}
    model = replace(case.model, effects=(ModelEffect("coulomb_friction", torques, np.zeros((3, 3))),))
    found = diagnose(case.recorded, model)
    assert found.verdict == "none"
    assert found.findings == ()
    assert all(share > 0.2 for share in found.at_rest.values())
