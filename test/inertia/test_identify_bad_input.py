"""`poise identify` and `poise evaluate` on input that cannot be right: one line that says what, where and the fix."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from poise.cli import run
from poise.recording import open_recording, rewrite_recording

BAGS = Path(__file__).parents[2] / "bags"
STATIC = BAGS / "kuka_static_poses.mcap"


def refusal(capsys, *arguments: str) -> str:
    """The one line of a command that ends with status 2."""
    assert run(list(arguments)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


@pytest.fixture(scope="module")
def nameless(tmp_path_factory) -> Path:
    """A recording whose wrenches name no frame."""
    recording = open_recording(STATIC)
    path = tmp_path_factory.mktemp("nameless") / "nameless.mcap"
    rewrite_recording(recording, path, {"wrench": replace(recording.wrench(), frame_id="")})
    return path


def test_wrenches_without_a_frame_are_refused_with_the_frames_there_are(nameless, capsys) -> None:
    error = refusal(capsys, "identify", str(nameless))
    assert "name no frame: give the sensor frame (--sensor-frame), of " in error
    assert set(error.strip().partition(", of ")[2].split(", ")) == {"base", "ft_sensor", "imu"}
    assert run(["identify", str(nameless), "--sensor-frame", "ft_sensor"]) == 0


def test_a_frame_of_the_wrench_that_nothing_places_is_refused_with_the_option_that_helps(tmp_path, capsys) -> None:
    recording = open_recording(STATIC)
    path = tmp_path / "wrist.mcap"
    rewrite_recording(recording, path, {"wrench": replace(recording.wrench(), frame_id="wrist")})
    error = refusal(capsys, "identify", str(path))
    assert "no pose of wrist; the bag holds base -> ft_sensor, ft_sensor -> imu; --sensor-frame gives" in error


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--sensor-frame", "wrist"], "no pose of wrist; the bag holds base -> ft_sensor, ft_sensor -> imu"),
        (["--sensor-frame", "sensor", "--urdf", "fr3"], "no frame 'sensor'; it has ft_sensor, base_link, fr3_link0"),
        (["--wrench-topic", "imu"], "topic imu carries sensor_msgs/msg/Imu, not geometry_msgs/msg/WrenchStamped"),
        (["--wrench-topic", "tf"], "topic tf carries tf2_msgs/msg/TFMessage, not geometry_msgs/msg/WrenchStamped"),
        (["--wrench-topic", "force"], "has no topic force: name another of wrench (geometry_msgs/msg/WrenchStamped)"),
    ],
)
def test_a_wrong_name_is_refused_with_those_there_are(arguments, text, capsys) -> None:
    assert text in refusal(capsys, "identify", str(STATIC), *arguments)


def test_streams_of_clocks_an_hour_apart_are_refused_with_the_time_between_them(tmp_path, capsys) -> None:
    recording = open_recording(STATIC)
    wrench, path = recording.wrench(), tmp_path / "apart.mcap"
    rewrite_recording(recording, path, {"wrench": replace(wrench, stamps=wrench.stamps + 3600 * 10**9)})
    assert run(["identify", str(path)]) == 3
    assert "wrench and motion do not overlap, 3." in capsys.readouterr().err


def test_a_folder_of_unrelated_recordings_is_not_weighed_as_one(capsys) -> None:
    error = refusal(capsys, "identify", str(BAGS))
    assert "holds 5 recordings (hammer_sweep.mcap, " in error
    assert "use `poise evaluate" in error


def test_evaluate_weighs_rosbag2_folders_and_lists_what_it_skipped(tmp_path, capsys) -> None:
    (tmp_path / "run").mkdir()
    shutil.copy(STATIC, tmp_path / "run" / "run_0.mcap")  # a recorder that was killed wrote no metadata.yaml
    (tmp_path / "notes").mkdir()
    (tmp_path / "README.md").write_text("notes")
    answer = tmp_path / "answer.json"
    assert run(["evaluate", str(tmp_path), "--method", "static", "--json", str(answer)]) == 0
    content = json.loads(answer.read_text())
    assert [Path(each["bag"]).name for each in content["recordings"]] == ["run"]
    assert content["skipped"] == ["README.md", "notes/"]
    assert "skipped, because they are no recordings: README.md, notes/" in capsys.readouterr().out
