"""The worked examples of mappings, and a command that weighs the same recording in every format."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import yaml
from other_formats import write_ros1, write_rosbag2
from test_tables import XYZ, named, pose_columns, write_csv

from poise.cli import run
from poise.recording import joint_commands, open_recording

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "recordings"
POSES = ROOT / "bags" / "kuka_static_poses.mcap"


def test_the_emps_example_is_a_real_recording():
    recording = open_recording(EXAMPLES / "emps", strict=True)
    joints = recording.joint_states()
    assert recording.counts == {"joint_states": 24841, "joint_commands": 24841, "robot_description": 1}
    assert joints.names == ("slide",)
    volts = scipy.io.loadmat(EXAMPLES / "emps" / "DATA_EMPS.mat")["vir"]
    np.testing.assert_allclose(joints.effort, 35.15065188 * volts)
    tracking = joint_commands(recording).position - joints.position
    assert np.abs(tracking).max() < 0.01, "the axis follows its reference"
    assert "prismatic" in recording.robot_description()


def test_the_tx40_example_turns_motors_into_joints(tmp_path):
    shutil.copy(EXAMPLES / "tx40.yaml", tmp_path / "columns.yaml")
    (tmp_path / "tx40_mdh_modified.urdf").write_text("<robot name='tx40'/>")
    time = np.arange(500) / 5000
    joint = 0.3 * np.sin(2 * np.pi * time[:, None] * np.arange(1, 7)) + np.array([0, -np.pi / 2, np.pi / 2, 0, 0, 0])
    torque = np.random.default_rng(8).normal(size=(500, 6))
    turns = joint - joint[0]
    motor = turns * [32, 32, 45, -48, 45, 32]
    motor[:, 5] += 32 * turns[:, 4]
    names = [f"Joint_{number}" for number in range(1, 7)]
    for file, values in (("pos_read_data.csv", motor), ("curr_data.csv", torque)):
        write_csv(tmp_path / file, dict(zip(names, values.T, strict=True)))
    found = open_recording(tmp_path).joint_states()
    np.testing.assert_allclose(found.position, joint, atol=1e-12)
    assert found.stamps[1] == 200_000
    speed, motor_speed = np.gradient(joint, axis=0), np.gradient(motor, axis=0)
    np.testing.assert_allclose((found.effort * speed).sum(axis=1), (torque * motor_speed).sum(axis=1), rtol=1e-9)


def test_the_so101_example_reads_lists_in_cells(tmp_path):
    shutil.copy(EXAMPLES / "so101.yaml", tmp_path / "columns.yaml")
    (tmp_path / "so101_new_calib.urdf").write_text("<robot name='so101'/>")
    (tmp_path / "joint_list.txt").write_text("Rotation\nPitch\nElbow\nWrist_Pitch\nWrist_Roll\nJaw\n")
    cells = '"[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]"'
    header = "type,timestamp,positions,velocities,torques\n"
    (tmp_path / "state_motor.csv").write_text(header + f"STATE_MOTOR,4.5,{cells},{cells},{cells}\n" * 2)
    (tmp_path / "control.csv").write_text(f"type,timestamp,positions\nCONTROL,20084.47,{cells}\n")
    recording = open_recording(tmp_path)
    joints = recording.joint_states(names=("gripper", "shoulder_pan"))
    assert joints.position.tolist() == [[0.6, 0.1]] * 2
    assert joints.stamps.tolist() == [4500, 4500]
    assert joint_commands(recording).stamps.tolist() == [20084470]


def write_tables(source, folder):
    """The 24 static poses as tables with a mapping."""
    recording = open_recording(source)
    folder.mkdir()
    wrench, moving = recording.wrench(), recording.poses("ft_sensor")
    force, torque = named("f", wrench.wrench_in_sensor[:, :3]), named("m", wrench.wrench_in_sensor[:, 3:])
    write_csv(folder / "wrench.csv", {"t": wrench.stamps, **force, **torque})
    write_csv(folder / "poses.csv", {"t": moving.stamps, **pose_columns(moving)})
    axes = [f"r{row}{column}" for row in "123" for column in "123"]
    pose = {"file": "poses.csv", "parent": moving.parent, "child": moving.child}
    topics = {
        "wrench": {"file": "wrench.csv", "frame": wrench.frame_id, "force": list(force), "torque": list(torque)},
        "tf": {**pose, "translation": [f"p{axis}" for axis in XYZ], "rotation": axes},
    }
    content = {"gravity": 9.82085, "time": {"column": "t", "unit": "ns"}, "topics": topics}
    (folder / "columns.yaml").write_text(yaml.safe_dump(content))
    return folder


@pytest.mark.parametrize("name", ["run.db3", "run", "run.bag", "tables"])
def test_identify_weighs_every_format_alike(tmp_path, name):
    path = tmp_path / name
    if name == "tables":
        write_tables(POSES, path)
    elif name == "run.bag":
        write_ros1(POSES, path)
    else:
        folder = write_rosbag2(POSES, tmp_path / "run", "db3", "FILE" if name == "run" else "none")
        path = folder if name == "run" else next(folder.glob("*.db3"))
    options = [] if name == "tables" else ["--gravity", "9.82085"]
    answers = []
    for source, more in ((POSES, []), (path, options)):
        assert run(["identify", str(source), "--json", str(tmp_path / "answer.json"), *more]) == 0
        answers.append(json.loads((tmp_path / "answer.json").read_text()))
    np.testing.assert_allclose(answers[1]["mass"], answers[0]["mass"], rtol=1e-9)
    np.testing.assert_allclose(answers[1]["com"], answers[0]["com"], rtol=1e-9)


def test_evaluate_weighs_the_recordings_of_a_folder(tmp_path):
    write_ros1(POSES, tmp_path / "run.bag")
    write_rosbag2(POSES, tmp_path / "folder", "db3")
    shutil.copy(POSES, tmp_path / "run.mcap")
    assert run(["evaluate", str(tmp_path), "--gravity", "9.82085", "--json", str(tmp_path / "answers.json")]) == 0
    answers = json.loads((tmp_path / "answers.json").read_text())["recordings"]
    assert [Path(answer["bag"]).name for answer in answers] == ["folder", "run.bag", "run.mcap"]
    assert np.ptp([answer["mass"] for answer in answers]) < 1e-9
