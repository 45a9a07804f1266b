"""`poise excite`: the file plays as planned, fields and picture are there, and bad input is one coded error."""

import json

import numpy as np
import pytest
import trimesh
import typer
from typer.testing import CliRunner

from poise.commands.excite import excite
from poise.errors import ErrorCode, PoiseError
from poise.excitation import Guard, certify, tool_centre
from poise.robot import RobotModel
from poise.simulation import check_limits, home, read_trajectory

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(excite)


def run(*arguments: str):
    found = CliRunner().invoke(app, list(arguments))
    if found.exception is not None and not isinstance(found.exception, SystemExit):
        raise found.exception
    return found


@pytest.mark.parametrize("kind", ["excitation", "stop_and_go"])
def test_the_file_plays_what_was_certified(tmp_path, kind) -> None:
    file, picture = tmp_path / "motion.yaml", tmp_path / "motion.png"
    extra = ["--stop-and-go"] if kind == "stop_and_go" else []
    found = run("xarm7", "--out", str(file), "--picture", str(picture), "--json", "-", *extra)
    said = json.loads(found.stdout)
    model = RobotModel.from_file("xarm7")
    motion = read_trajectory(file, model)
    check_limits(model, motion)
    proof = certify(model, motion, Guard.ball(tool_centre(model, "tcp"), 0.15))
    assert said["kind"] == kind
    assert proof.speed == pytest.approx(said["speed"], rel=1e-6)
    assert proof.speed <= said["speed_limit"] == 0.25
    assert proof.duration == pytest.approx(said["duration"])
    np.testing.assert_allclose(motion.position[[0, -1]], [home(model)] * 2, atol=1e-9)
    assert 0 < said["expected_std"]["mass"] < 0.05
    assert len(said["expected_std"]["com"]) == 3
    assert len(said["expected_std"]["inertia"]) == 6
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_mesh_is_guarded_by_its_corners(tmp_path) -> None:
    mesh = trimesh.creation.box((0.04, 0.04, 0.3))
    mesh.apply_translation((0.0, 0.0, 0.2))
    mesh.export(tmp_path / "bar.stl")
    said = json.loads(run("fr3", "--object", str(tmp_path / "bar.stl"), "--json", "-").stdout)
    assert said["speed"] <= 0.25


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["r2d2"], ErrorCode.FILE_UNREADABLE),
        (["fr3", "--start", "1,2"], ErrorCode.TYPE_MISMATCH),
        (["fr3", "--start", "a"], ErrorCode.BAD_INPUT),
        (["fr3", "--tcp", "hook"], ErrorCode.FRAME_UNKNOWN),
        (["fr3", "--speed", "-1"], ErrorCode.BAD_INPUT),
        (["fr3", "--duration", "nan"], ErrorCode.BAD_INPUT),
        (["fr3", "--speed", "0.0005", "--stop-and-go"], ErrorCode.UNREACHABLE),
        (["fr3", "--stop-and-go", "--picture", "motion.gif"], ErrorCode.UNSUPPORTED),
        (["fr3", "--object", "nothing.stl"], ErrorCode.FILE_UNREADABLE),
    ],
)
def test_bad_input_is_one_coded_error(arguments, code) -> None:
    with pytest.raises(PoiseError) as caught:
        run(*arguments)
    assert caught.value.code == code
