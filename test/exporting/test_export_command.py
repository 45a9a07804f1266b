"""`poise identify --export`: files whole or none, refused before anything is computed, remarks on what is left out."""

import json
from pathlib import Path

import pytest

from poise.cli import run

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
    ],
)
def test_a_bad_request_is_refused_before_the_recording_is_read(tmp_path, capsys, arguments, text) -> None:
    words = [word.replace("{tmp}", str(tmp_path)) for word in arguments]
    assert identify(*words) == 2
    assert text in capsys.readouterr().err
