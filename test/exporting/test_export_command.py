"""`poise identify --export`: files whole or none, refused before anything is computed, remarks on what is left out."""

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from poise.cli import run
from poise.inertia import InertialParameters
from poise.recording import write_recording
from poise.robot import RobotModel, find_urdf, read_urdf
from poise.simulation import FourierTrajectory, IdealRobot, JointNoise, record, wrench_noise

BAG = Path(__file__).parents[2] / "bags" / "kuka_static_poses.mcap"


def identify(*arguments: str) -> int:
    """The exit status of `poise identify` on a bag of static poses: mass and centre of mass, no inertia."""
    return run(["identify", str(BAG), "--method", "static", *arguments])


def test_a_payload_is_written_to_files_and_to_stdout(tmp_path, capsys) -> None:
    target = tmp_path / "payload.py"
    answer = tmp_path / "answer.json"
    assert identify("--export", f"xarm:{target}", "--export", "ur", "--json", str(answer)) == 0
    mass = json.loads(answer.read_text())["mass"]
    output = capsys.readouterr()
    assert f"set_target_payload({mass:.9f}, [" in output.out
    assert f"arm.set_tcp_load({mass!r}, [" in target.read_text()
    assert "warning: xarm cannot express inertia" in output.err


def test_the_flange_pose_moves_the_centre_of_mass(tmp_path) -> None:
    here, there = tmp_path / "here.json", tmp_path / "there.json"
    assert identify("--export", f"xarm:{here}") == 0
    assert identify("--export", f"xarm:{there}", "--flange-pose", "0 0 0.05 0 0 0 1") == 0
    centres = [json.loads(f"[{path.read_text().split(', [')[1].split(']')[0]}]") for path in (here, there)]
    assert centres[1] == pytest.approx([centres[0][0], centres[0][1], centres[0][2] + 50.0])


def test_a_format_that_needs_more_than_is_known_ends_with_status_3_and_writes_nothing(tmp_path, capsys) -> None:
    first, second = tmp_path / "payload.py", tmp_path / "payload.urdf"
    assert identify("--export", f"xarm:{first}", "--export", f"urdf:{second}") == 3
    assert "export urdf needs inertia" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--export", "abb:x"], "no exporter writes 'abb'"),
        (["--export", "ur", "--json", "-"], "both write to stdout"),
        (["--export", "ur", "--flange-pose", "1 2 3"], "give seven numbers"),
        (["--export", "ur", "--flange-pose", "0 0 0 0 0 0 0"], "give seven numbers"),
        (["--export", "ur:{tmp}"], "folder"),
        (["--export", "ur", "--frame", "imu", "--flange-pose", "0 0 0 0 0 0 1"], "give one"),
        (["--frame", "imu"], "--frame is for --export"),
        (["--export", "ur", "--gripper", "0.5"], "give MASS,X,Y,Z or"),
        (["--export", "ur", "--gripper", "0.5,0,0,0.1,1e-3,0,0,1e-3,0,5e-3"], "give MASS,X,Y,Z or"),
        (["--export", "ur", "--gripper", "{tmp}/none.json"], "no such file"),
    ],
)
def test_a_bad_request_is_refused_before_the_recording_is_read(tmp_path, capsys, arguments, text) -> None:
    words = [word.replace("{tmp}", str(tmp_path)) for word in arguments]
    assert identify(*words) == 2
    assert text in capsys.readouterr().err


OBJECT = InertialParameters(1.2, np.array([0.02, -0.03, 0.16]), np.diag([6e-3, 5e-3, 3e-3]))


@pytest.fixture(scope="module")
def moved(tmp_path_factory) -> Path:
    """An FR3 in motion that holds 1.2 kg in the gripper of its description."""
    rng = np.random.default_rng(5)
    robot = RobotModel.from_file("fr3")
    motion = FourierTrajectory.random(robot, rng, duration=4.0)
    made = record(
        IdealRobot(robot, OBJECT.phi + robot.load_in_sensor),
        motion,
        rng,
        wrench_noise("low", rate=200.0),
        JointNoise(rate=200.0),
    )
    path = tmp_path_factory.mktemp("moved") / "moved.mcap"
    streams = {"joint_states": made.joints, "wrench": made.wrench}
    write_recording(path, streams, robot_description=read_urdf(find_urdf("fr3")))
    return path


def test_values_in_a_named_frame_without_the_gripper_of_the_robot_description(moved, tmp_path, capsys) -> None:
    answer, target, urdf = (tmp_path / name for name in ("answer.json", "load.json", "arm.urdf"))
    words = ["identify", str(moved), "--method", "ols", "--gripper", "urdf", "--json", str(answer)]
    exports = ["--export", f"franka:{target}", "--frame", "flange"]
    assert run([*words, *exports]) == 0
    assert "flange frame" not in capsys.readouterr().err
    robot = RobotModel.from_file("fr3")
    model, data = robot.pinocchio, robot.pinocchio.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    flange, sensor = (data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in ("flange", "ft_sensor"))
    pose = flange.actInv(sensor)
    weighed = json.loads(answer.read_text())
    inertia = np.zeros((3, 3))
    inertia[np.triu_indices(3)] = weighed["inertia"]
    total = InertialParameters(weighed["mass"], weighed["com"], inertia + np.triu(inertia, 1).T)
    truth = (total - InertialParameters.from_phi(robot.load_in_sensor)).in_frame(pose.rotation, pose.translation)
    request = json.loads(target.read_text())
    assert request["mass"] == pytest.approx(truth.mass)
    np.testing.assert_allclose(request["center_of_mass"], truth.com, atol=1e-9)
    np.testing.assert_allclose(np.reshape(request["load_inertia"], (3, 3)), truth.inertia, atol=1e-9)

    assert run([*words, "--export", f"urdf-robot:{urdf}"]) == 0
    patched = RobotModel.from_urdf(urdf.read_text())
    assert patched.load_in_sensor[0] == pytest.approx(weighed["mass"])
    assert run([*words[:4], "--export", "urdf-link", "--frame", "flange"]) == 2
    assert "would count twice" in capsys.readouterr().err


def test_a_frame_of_tf_and_a_weighed_gripper(tmp_path, capsys) -> None:
    first, empty = tmp_path / "all.json", tmp_path / "empty.json"
    assert identify("--export", f"json:{first}", "--frame", "imu") == 0
    held = json.loads(first.read_text())
    assert (held["frame_id"], held["sensor_frame"]) == ("imu", "ft_sensor")
    assert identify("--json", str(empty)) == 0
    content = json.loads(empty.read_text())
    content["mass"] /= 2
    empty.write_text(json.dumps(content))
    capsys.readouterr()
    assert identify("--export", "xarm", "--gripper", str(empty)) == 0
    output = capsys.readouterr()
    mass = float(output.out.split("set_tcp_load(")[1].split(",")[0])
    assert mass == pytest.approx(content["mass"])
    assert "ft_sensor is taken as the flange: give --frame or --flange-pose" in output.err


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"frame_id": "tool0"}, "the gripper is given in tool0, and the payload was weighed in ft_sensor"),
        ({"findings": [{"code": 70, "sentence": "a poor fit"}]}, "its own weighing may be wrong: a poor fit"),
        ({"mass": None}, "give MASS,X,Y,Z or"),
        ({"mass": 5.0}, "the gripper that was taken off is not part of what was weighed"),
    ],
)
def test_a_gripper_that_cannot_be_right_is_refused(change, text, tmp_path, capsys) -> None:
    file = tmp_path / "gripper.json"
    file.write_text(json.dumps({"mass": 0.1, "com": [0, 0, 0.04], "inertia": None, "frame_id": "ft_sensor"} | change))
    assert identify("--export", "xarm", "--gripper", str(file)) in (2, 3)
    assert text in capsys.readouterr().err


def test_a_frame_that_is_not_fixed_to_the_sensor_is_refused_with_those_that_are(moved, capsys) -> None:
    assert identify("--export", "ur", "--frame", "base") == 2
    assert "these are: ft_sensor, imu" in capsys.readouterr().err
    assert run(["identify", str(moved), "--method", "ols", "--export", "ur", "--frame", "fr3_link6"]) == 2
    error = capsys.readouterr().err
    assert "ft_sensor" in error.split("these are")[1]
    assert "flange" in error.split("these are")[1]
    assert "fr3_link6" not in error.split("these are")[1]
