"""Effects of joint efforts that are selected together: what soft friction or a load had hidden."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.model_export import ROBOTS, nominal_mjcf, plant, recording, stated_payload
from benchmarks.random_effects import random_case
from poise.mismatch.effects import all_effects
from poise.mismatch.inference import FittedEffect, effort_problem
from poise.mismatch.inference.linear_screen import _repeated, screened
from poise.mismatch.reading import load_model, on_efforts, read_recording
from poise.recording import open_recording, write_recording
from poise.robot import RobotModel, find_urdf, read_urdf


@pytest.mark.parametrize(
    ("seed", "expected"),
    [
        (759, {"payload_parameters", "coulomb_friction", "motor_inertia"}),  # rotors: 1 % of the error of the load
        (790, {"payload_parameters", "coulomb_friction", "viscous_friction"}),  # friction over position was selected
    ],
)
def test_what_is_planted_in_mujoco_is_selected(seed: int, expected: set[str], tmp_path: Path) -> None:
    rng, robot = np.random.default_rng([7, seed]), ROBOTS[seed % len(ROBOTS)]
    xml, joints = nominal_mjcf(robot)
    stream, _, _ = recording(plant(xml, joints, rng)[0], robot, joints, rng, 30.0)
    bag, stated = tmp_path / "run.mcap", tmp_path / "model.yaml"
    write_recording(bag, {"joint_states": stream}, robot_description=read_urdf(find_urdf(robot)))
    stated.write_text(
        yaml.safe_dump({"sensor_frame": RobotModel.from_file(robot).sensor_frame, "payload": stated_payload()})
    )
    found = _selected(bag, stated)
    assert {part.effect.name for part in found if not part.effect.free_course} == expected


def test_an_event_is_looked_for_in_what_the_tolerances_leave(tmp_path: Path) -> None:
    """Beside a payload at the edge of its tolerance, a push of the base (2,000 nats) was no burst, and so `none`."""
    made = random_case(7849, tmp_path)
    made.write(tmp_path / "case")
    (found,) = _selected(tmp_path / "case" / "recording.mcap", tmp_path / "case" / "model.yaml")
    assert found.effect.name == "base_motion"
    start, end = found.values["start"], found.values["start"] + found.values["length"]
    assert start == pytest.approx(5.9, abs=0.3)
    assert end == pytest.approx(7.9, abs=0.5)


def _selected(bag: Path, stated: Path) -> tuple[FittedEffect, ...]:
    read = read_recording(open_recording(bag), load_model(stated))
    problem = effort_problem(read.recorded, read.model)
    effects = [on_efforts(each, problem.recorded) for each in all_effects()]
    library = [each for each in effects if each.signal == "effort" and not each.untestable(problem.recorded)]
    return screened(problem, library)


@pytest.mark.parametrize(
    ("falls", "repeated"),
    [
        ([0.3, 0.2, 0.1, 0.2, -0.1, -0.1], True),  # in four of six blocks
        ([0.4, 0.3, 0.3, -0.002, -0.003, -0.001], True),  # knocks in three blocks, and none in the others
        ([0.4, 0.3, 0.3, -0.1, -0.1, -0.1], False),  # it raises the error of the others
        ([0.6, 0.4, -0.001, -0.001, -0.001, -0.001], False),  # two blocks repeat too little
    ],
)
def test_an_effect_acts_again_in_most_blocks_or_rests(falls: list[float], repeated: bool) -> None:
    assert _repeated(np.array(falls)[:, None] * [1.0, 0.5]) is repeated
