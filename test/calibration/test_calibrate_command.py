"""`poise calibrate` with a recording: images become views of the board, and the answer a file."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from benchmarks.calibration import LINK, World, errors_of, views_of
from poise import cli
from poise.calibration import Board, read_calibration
from poise.fake_robots.sweep_bag import image_bytes, info_bytes
from poise.recording import JointStream, RecordingWriter, encode_stream, encode_text
from poise.robot import find_urdf, read_urdf

IMAGE, INFO = "camera/color/image_raw", "camera/color/camera_info"
KINDS = {
    "robot_description": "std_msgs/msg/String",
    "joint_states": "sensor_msgs/msg/JointState",
    INFO: "sensor_msgs/msg/CameraInfo",
    IMAGE: "sensor_msgs/msg/Image",
}
SEEN = views_of(World(distortion=()), 3)


def recording(path: Path, without: str = "") -> Path:
    """The arm rests at each view; the grey value of an image is its number."""
    stamps = np.concatenate([each.stamp + np.arange(-5, 6) * 10**7 for each in SEEN.sightings]) + 10**9
    position = np.repeat([each.position for each in SEEN.sightings], 11, axis=0)
    unknown = np.full_like(position, np.nan)
    states = JointStream(stamps, SEEN.kinematics.joint_names, position, unknown, unknown)
    messages = [(0, "robot_description", encode_text(read_urdf(find_urdf("fr3"))))]
    messages += [(stamp, "joint_states", data) for stamp, data in encode_stream("joint_states", states)]
    for number, each in enumerate(SEEN.sightings):
        stamp = each.stamp + 10**9
        messages.append((stamp, INFO, info_bytes(stamp, "eye", SEEN.camera)))
        messages.append((stamp, IMAGE, image_bytes(stamp, "eye", np.full((4, 4, 3), number, np.uint8), "rgb8")))
    with RecordingWriter(path) as writer:
        for topic, kind in KINDS.items():
            writer.add_topic(topic, kind)
        for stamp, topic, data in sorted(messages, key=lambda message: message[0]):
            if topic != without:
                writer.write(topic, stamp, data)
    return path


@pytest.fixture(autouse=True)
def found_by_number(monkeypatch: pytest.MonkeyPatch) -> None:
    def detect(image: Any) -> Any:
        each = SEEN.sightings[int(image[0, 0, 0])]
        return each.corners, each.pixels

    monkeypatch.setattr(Board, "detector", lambda _: detect)


def test_a_recording_becomes_a_file_and_a_description(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag, out, urdf = recording(tmp_path / "views.mcap"), tmp_path / "calibration.yaml", tmp_path / "robot.urdf"
    arguments = ["calibrate", str(bag), "--link", LINK, "--out", str(out), "--urdf-out", str(urdf), "--json", "-"]
    assert cli.run(arguments) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["hand_eye"]["link"] == LINK
    assert "not identified: fr3_joint1" in printed.err
    assert np.abs(errors_of(SEEN.eye, read_calibration(out).hand_eye)[3:]).max() < 2e-3
    assert len(yaml.safe_load(out.read_text())["provenance"]["sha256"]) == 64
    assert "fr3_joint1" in urdf.read_text()


@pytest.mark.parametrize(
    ("arguments", "without", "word"),
    [
        ([], "", "FRAME_UNKNOWN|hand-eye"),
        (["--link", "elbow"], "", "no link"),
        (["--link", LINK], INFO, "camera_info"),
        (["--link", LINK], "joint_states", "joint_states"),
        (["--squares", "eight"], "", "COLUMNSxROWS"),
    ],
)
def test_what_is_missing_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], without: str, word: str
) -> None:
    assert cli.run(["calibrate", str(recording(tmp_path / "views.mcap", without)), *arguments]) == 2
    said = capsys.readouterr().err
    assert any(each in said for each in word.split("|")), said


def test_a_printed_board_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    path = tmp_path / "board.png"
    assert cli.run(["calibrate", "--draw-board", str(path)]) == 0
    image = cv2.copyMakeBorder(cv2.imread(str(path)), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=(255, 255, 255))
    corners, pixels = Board().detector()(image)
    assert len(corners) == 35
    step = np.linalg.norm(pixels[1] - pixels[0]) / np.linalg.norm(corners[1] - corners[0])
    np.testing.assert_allclose(np.ptp(pixels, axis=0), step * np.ptp(corners, axis=0), rtol=0.01)
