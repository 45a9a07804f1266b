"""`poise mismatch --export KIND:FILE`: a model comes closer to the recording, and the user's file is not touched."""

from pathlib import Path

import pytest

from benchmarks.model_export import nominal_mjcf, one
from poise.cli import run
from poise.commands.exports import robot_description
from poise.recording import open_recording
from poise.robot import find_urdf, read_urdf

BAG = Path(__file__).parents[2] / "bags" / "kuka_free_motion.mcap"


def test_rotors_come_back_from_the_exported_model_and_it_runs_closer(tmp_path) -> None:
    """MuJoCo makes the recording, and reads and runs the file."""
    result = one(1, tmp_path, seconds=12.0, windows=2)
    assert result["exit"] == 0
    assert result["planted"] == ["armature"]
    assert result["named"] == ["motor_inertia"]
    assert max(result["off"]) < 0.15
    assert result["left"] < 0.1
    assert (tmp_path / "robot.xml").read_text() == nominal_mjcf("xarm7")[0]


def test_model_yaml_may_name_a_robot_that_comes_with_poise() -> None:
    assert robot_description(open_recording(BAG), Path("fr3")) == read_urdf(find_urdf("fr3"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--export", "mjcf:{tmp}/new.xml"], "give it with --into"),
        (["--export", "mjcf"], "give KIND:FILE"),
        (["--export", "mjcf:{tmp}/old.xml", "--into", "{tmp}/old.xml"], "would overwrite --into"),
        (["--export", "mjcf:{tmp}/new.xml", "--into", "{tmp}/none.xml"], "no such file"),
        (["--into", "{tmp}/old.xml"], "has no --export"),
        (["--export", "mjcf:{tmp}/locked.xml", "--into", "{tmp}/old.xml"], "the file is read-only"),
        (["--export", "usd:{tmp}/a.usd"], "use one of json, mjcf, sdf, urdf"),
    ],
)
def test_bad_requests_are_refused_before_anything_is_computed(tmp_path, capsys, words: list[str], said: str) -> None:
    (tmp_path / "old.xml").write_text("<mujoco/>")
    (tmp_path / "locked.xml").write_text("<mujoco/>")
    (tmp_path / "locked.xml").chmod(0o444)
    assert run(["mismatch", str(BAG), *(word.format(tmp=tmp_path) for word in words)]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys(
        ("old.xml", "locked.xml"), "<mujoco/>"
    )
