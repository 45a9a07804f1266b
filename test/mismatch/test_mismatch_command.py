"""`poise mismatch` on recordings that are not as they should be: a number and a sentence, never a traceback."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import Case, make_case

from poise.cli import run
from poise.inertia import InertialParameters
from poise.mismatch.reading import NominalModel, dump_model
from poise.recording import JointStream, WrenchStream, write_recording
from poise.robot.model import find_urdf
from poise.robot.urdf import read_urdf

SHORT = 12.0
BAD_INPUT, NO_ANSWER = 2, 3


@pytest.fixture(scope="module")
def case() -> Case:
    return make_case(5, duration=SHORT)


@pytest.fixture
def robot() -> str:
    return read_urdf(find_urdf("ridgeback_ur10"))


def written(
    folder: Path, robot: str, joints: JointStream | None, wrench: WrenchStream, model: NominalModel
) -> list[str]:
    """A bag and its model, as arguments of the command."""
    bag, nominal = folder / "run.mcap", folder / "model.yaml"
    streams = {"wrench": wrench} if joints is None else {"wrench": wrench, "joint_states": joints}
    write_recording(bag, streams, robot_description=robot)  # type: ignore[arg-type]
    nominal.write_text(dump_model(model))
    return ["mismatch", str(bag), "--model", str(nominal)]


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str], status: int = BAD_INPUT) -> str:
    """The one line of a command that ends with bad input, or without an answer."""
    assert run(arguments) == status
    lines = [line for line in capsys.readouterr().err.splitlines() if "warning" not in line]
    assert len(lines) == 1
    return lines[0]


def test_without_joint_states_it_says_what_to_record(
    tmp_path: Path, case: Case, robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "joint_states" in refused(written(tmp_path, robot, None, case.wrench, case.model), capsys)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("ft/wrench_raw", "joint_states"), "ft/wrench_raw (geometry_msgs/msg/WrenchStamped) was not read: rename it"),
        (("wrench", "joint_states_raw"), "joint_states_raw (sensor_msgs/msg/JointState) was not read: rename it"),
    ],
)
def test_a_topic_of_another_name_is_named(
    names: tuple[str, str], said: str, tmp_path: Path, case: Case, robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, nominal = tmp_path / "run.mcap", tmp_path / "model.yaml"
    joints = replace(case.joints, effort=np.full_like(case.joints.effort, np.nan))
    write_recording(bag, dict(zip(names, (case.wrench, joints), strict=True)), robot_description=robot)
    nominal.write_text(dump_model(case.model))
    assert said in refused(["mismatch", str(bag), "--model", str(nominal)], capsys)


def test_torque_in_newton_millimetres_is_named(
    tmp_path: Path, case: Case, robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = replace(case.wrench, wrench_in_sensor=case.wrench.wrench_in_sensor * np.repeat([1.0, 1000.0], 3))
    assert "N mm" in refused(written(tmp_path, robot, case.joints, wrong, case.model), capsys)


def test_the_opposite_sign_is_named(tmp_path: Path, case: Case, robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = replace(case.wrench, wrench_in_sensor=-case.wrench.wrench_in_sensor)
    assert "opposite sign" in refused(written(tmp_path, robot, case.joints, wrong, case.model), capsys)


def test_with_another_robots_description_there_is_no_answer(
    tmp_path: Path, case: Case, capsys: pytest.CaptureFixture[str]
) -> None:
    other = '<robot name="other"><link name="base"/><link name="ft_sensor"/><joint name="a" type="revolute">'
    other += '<parent link="base"/><child link="ft_sensor"/><axis xyz="0 0 1"/>'
    other += '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>'
    arguments = written(tmp_path, other, case.joints, case.wrench, case.model)
    assert "another robot" in refused(arguments, capsys, NO_ANSWER)


def test_gaps_and_bursts_of_nan_are_left_out_and_said(
    tmp_path: Path, case: Case, robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    values = case.wrench.wrench_in_sensor.copy()
    values[400:450] = np.nan
    seconds = (case.joints.stamps - case.joints.stamps[0]) * 1e-9
    joints = case.joints.select((seconds < 7.0) | (seconds > 7.5))
    answer = tmp_path / "answer.json"
    arguments = written(tmp_path, robot, joints, replace(case.wrench, wrench_in_sensor=values), case.model)
    assert run([*arguments, "--json", str(answer)]) == 0
    said = json.loads(answer.read_text())
    assert any("not finite" in note for note in said["notes"])
    assert any("no joint motion" in note for note in said["notes"])
    assert said["verdict"] == "none"


def test_a_payload_that_is_not_stated_is_identified_from_the_recording(tmp_path: Path, case: Case, robot: str) -> None:
    answer, saved = tmp_path / "answer.json", tmp_path / "saved.yaml"
    arguments = written(tmp_path, robot, case.joints, case.wrench, replace(case.model, phi=None))
    assert run([*arguments, "--json", str(answer), "--save", str(saved)]) == 0
    said = json.loads(answer.read_text())
    assert said["verdict"] == "none"
    assert "payload_parameters" in said["untestable"]


def test_without_motion_it_says_what_cannot_be_tested_and_what_motion_would(
    tmp_path: Path, case: Case, robot: str
) -> None:
    count, held = len(case.joints.stamps), case.joints.position[:1]
    joints = replace(case.joints, position=np.repeat(held, count, axis=0), velocity=np.zeros((count, held.shape[1])))
    rng = np.random.default_rng(0)
    body = InertialParameters.from_phi(case.exact.phi)
    still = case.exact.gravity[0] * body.mass
    wrench = np.concatenate([still, np.cross(body.com, still)]) + rng.normal(size=(len(case.wrench.stamps), 6)) * (
        np.repeat([0.1, 0.005], 3)
    )
    answer = tmp_path / "answer.json"
    arguments = written(tmp_path, robot, joints, replace(case.wrench, wrench_in_sensor=wrench), case.model)
    assert run([*arguments, "--json", str(answer)]) == 0
    said = json.loads(answer.read_text())
    assert {"air_drag", "flywheel", "joint_offset"} <= set(said["untestable"])
    assert all(said["untestable"].values())


def test_the_fields_of_an_answer(tmp_path: Path, robot: str) -> None:
    case = make_case(6, (("sensor_bias", 1.0),), duration=20.0)
    answer = tmp_path / "answer.json"
    assert run([*written(tmp_path, robot, case.joints, case.wrench, case.model), "--json", str(answer)]) == 0
    said = json.loads(answer.read_text())
    assert {"verdict", "effects", "where", "unknown", "fit", "seconds"} <= set(said)
    assert set(said["fit"]) >= {"noise_floor", "holdout"}
    assert {"nominal", "augmented"} <= set(said["fit"]["holdout"])
    (effect,) = said["effects"]
    assert set(effect) >= {
        *("name", "probability", "parameters", "windows", "sentence", "rivals", "indistinguishable_from"),
    }
    assert set(effect["parameters"]["force_x"]) == {"value", "std", "unit"}
    assert all({"start", "end", "channels", "band_hz", "depends_on", "share"} <= set(w) for w in said["where"])


def test_joint_positions_in_degrees_are_named(
    tmp_path: Path, case: Case, robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = replace(case.joints, position=np.rad2deg(case.joints.position))
    assert "degrees" in refused(written(tmp_path, robot, wrong, case.wrench, case.model), capsys)


def test_newton_millimetres_are_named_without_a_payload_to_hold_them_against(
    tmp_path: Path, case: Case, robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = replace(case.wrench, wrench_in_sensor=case.wrench.wrench_in_sensor * np.repeat([1.0, 1000.0], 3))
    assert "N mm" in refused(written(tmp_path, robot, case.joints, wrong, replace(case.model, phi=None)), capsys)


def test_a_payload_that_is_absent_is_a_finding(tmp_path: Path, case: Case, robot: str) -> None:
    noise = np.random.default_rng(1).normal(size=case.wrench.wrench_in_sensor.shape) * np.repeat([0.1, 0.005], 3)
    answer = tmp_path / "answer.json"
    arguments = written(tmp_path, robot, case.joints, replace(case.wrench, wrench_in_sensor=noise), case.model)
    assert run([*arguments, "--json", str(answer)]) == 0
    said = json.loads(answer.read_text())
    assert [effect["name"] for effect in said["effects"]] == ["payload_parameters"]
    assert "not there" in said["effects"][0]["sentence"]


@pytest.mark.parametrize(
    ("spoilt", "word"), [("still", "sensor on"), ("torque", "torque has the opposite sign"), ("short", "at the least")]
)
def test_a_recording_that_cannot_be_right_is_refused_in_words(
    spoilt: str, word: str, tmp_path: Path, case: Case, robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    values = case.wrench.wrench_in_sensor
    wrong = {
        "still": replace(case.wrench, wrench_in_sensor=np.zeros_like(values)),
        "torque": replace(case.wrench, wrench_in_sensor=values * np.repeat([1.0, -1.0], 3)),
        "short": case.wrench.select(slice(0, 300)),
    }[spoilt]
    assert word in refused(written(tmp_path, robot, case.joints, wrong, case.model), capsys)


def test_joint_states_without_accelerations_in_them_are_refused(
    tmp_path: Path, case: Case, robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rare = case.joints.select(slice(None, None, 25))
    assert "50 Hz" in refused(written(tmp_path, robot, rare, case.wrench, case.model), capsys)
