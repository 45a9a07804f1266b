"""The designed excitation: a motion whose recording resolves what the first one left ambiguous."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from cases import ARM_HOME, ROBOT, make_case

from poise.cli import run
from poise.mismatch.answer.discriminating_motion import distance
from poise.mismatch.effects import Values, effect_named
from poise.mismatch.inference import FittedEffect, wrench_problem
from poise.mismatch.reading import NominalModel, dump_model, recorded_from_motion
from poise.mismatch.recorded import RecordedMotion
from poise.recording import write_recording
from poise.robot.model import find_urdf
from poise.robot.urdf import read_urdf
from poise.simulation import FourierTrajectory, check_limits, read_trajectory

PHI = make_case(5, duration=5.0).exact.phi


def slow_sine(duration: float = 24.0) -> FourierTrajectory:
    """One slow sine in the wrist: a late clock and a low-pass filter are one."""
    sine = np.array([[0.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.8, 0.8, 0.6]])
    return FourierTrajectory(ARM_HOME, sine, np.zeros_like(sine), 0.125, duration, 8.0)


def along(trajectory: FourierTrajectory) -> RecordedMotion:
    seconds = np.arange(int(trajectory.duration * 100)) / 100
    recorded = recorded_from_motion(ROBOT, seconds, trajectory.at(seconds), PHI)
    noise = np.random.default_rng(0).normal(size=recorded.wrench.shape) * np.repeat([0.1, 0.005], 3)
    return replace(recorded, wrench=recorded.prediction + noise)


def part(name: str, values: Values) -> FittedEffect:
    effect = effect_named(name)
    assert effect is not None
    return FittedEffect(effect, values)


def test_the_distance_is_small_where_two_effects_look_alike_and_none_to_itself() -> None:
    late, filtered = part("clock_offset", {"offset": 0.03}), part("low_pass", {"time_constant": 0.03})
    slow = wrench_problem(along(slow_sine()), NominalModel(phi=PHI))
    fast = slow_sine()
    fast = replace(fast, sine=fast.sine / 5, frequency=0.9)
    assert distance(slow, slow.recorded, (), late, late) == pytest.approx(0.0, abs=0.1)
    near, far = (distance(slow, along(motion), (), late, filtered) for motion in (slow_sine(), fast))
    assert 0.0 <= near < 5.0
    assert far > 10.0 * near


def test_the_designed_motion_separates_what_the_recording_could_not(tmp_path: Path) -> None:
    """The whole way of a user: diagnose, ask for the motion, run it (here the simulator does), diagnose again."""
    truth = make_component(tmp_path)
    first = simulated(tmp_path, "first", truth, trajectory_file(tmp_path))
    motion, answer = tmp_path / "motion.yaml", tmp_path / "answer.json"
    nominal = tmp_path / "model.yaml"
    asked = ["mismatch", str(first), "--model", str(nominal), "--json", str(answer), "--separate", str(motion)]
    assert run(asked) == 0
    said = json.loads(answer.read_text())
    assert said["effects"][0]["indistinguishable_from"]
    design = said["designed_motion"]
    assert set(design["between"]) == {"low_pass", "clock_offset"}
    assert design["enough"]
    trajectory = read_trajectory(motion, ROBOT)
    check_limits(ROBOT, trajectory)
    assert np.ptp(trajectory.at(np.linspace(0, trajectory.duration, 50)).position[:, :3]) == 0.0  # the base stands
    second = simulated(tmp_path, "second", truth, motion)
    assert run(["mismatch", str(second), "--model", str(nominal), "--json", str(answer)]) == 0
    (effect,) = json.loads(answer.read_text())["effects"]
    assert effect["name"] == "low_pass"
    assert effect["indistinguishable_from"] == []
    assert effect["parameters"]["time_constant"]["value"] == pytest.approx(0.03, rel=0.1)


def make_component(folder: Path) -> Path:
    """model.yaml of the truth, a filter of 30 ms, beside that of the nominal model."""
    nominal = NominalModel(sensor_frame="ft_sensor", phi=PHI)
    (folder / "model.yaml").write_text(dump_model(nominal))
    content = yaml.safe_load(dump_model(nominal))
    content["effects"] = [{"name": "low_pass", "parameters": {"time_constant": 0.03}}]
    path = folder / "truth.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def trajectory_file(folder: Path) -> Path:
    times = np.arange(0.0, 24.01, 0.25)
    motion = slow_sine().at(times)
    points = [
        {"time": float(t), "position": q.tolist(), "velocity": v.tolist(), "acceleration": a.tolist()}
        for t, q, v, a in zip(times, *motion, strict=True)
    ]
    path = folder / "sine.yaml"
    path.write_text(yaml.safe_dump({"joints": list(ROBOT.joint_names), "waypoints": points}))
    return path


def simulated(folder: Path, name: str, model: Path, motion: Path) -> Path:
    path = folder / f"{name}.mcap"
    arguments = ["--motion", str(motion), "--urdf", "ridgeback_ur10", "--noise", "--out", str(path)]
    assert run(["simulate", str(model), *arguments]) == 0
    return path


def test_nothing_is_designed_where_nothing_is_open(tmp_path: Path) -> None:
    case = make_case(5, duration=12.0)
    bag, model, answer = tmp_path / "run.mcap", tmp_path / "model.yaml", tmp_path / "answer.json"
    urdf = read_urdf(find_urdf("ridgeback_ur10"))
    write_recording(bag, {"wrench": case.wrench, "joint_states": case.joints}, robot_description=urdf)
    model.write_text(dump_model(case.model))
    motion = tmp_path / "motion.yaml"
    assert run(["mismatch", str(bag), "--model", str(model), "--json", str(answer), "--separate", str(motion)]) == 0
    assert json.loads(answer.read_text())["designed_motion"] is None
    assert not motion.exists()
