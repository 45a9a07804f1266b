"""The committed sweep: from the bag to the parts, and bags that lack what a scan needs."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from poise.cli import run
from poise.errors import ErrorCode, InputError
from poise.inertia.model.object_shape import load_object
from poise.recording import RecordingWriter, open_recording
from poise.robot import Mounting
from poise.scanning import ScanOptions, SweepOptions, read_sweep, scan_sweep
from poise.shape.clouds import read_cloud

BAG = Path(__file__).parents[2] / "bags" / "hammer_sweep.mcap"
MANIFEST = yaml.safe_load((BAG.parent / "manifest.yaml").read_text())["bags"]
TRUE_VOLUME = 2.0821e-4
DEPTH, INFO = "camera/aligned_depth_to_color/image_raw", "camera/aligned_depth_to_color/camera_info"


def copied(path, change=lambda message: message.data, without=()):
    """The bag without some topics, and its messages changed."""
    recording = open_recording(BAG)
    with RecordingWriter(path) as writer:
        for name, kind in recording.topics.items():
            if name not in without:
                writer.add_topic(name, kind)
        for message in recording.messages([name for name in recording.topics if name not in without]):
            data = change(message)
            if data is not None:
                writer.write(message.topic, message.log_time, data)
    return path


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_sweep(open_recording(path), SweepOptions())
    return caught.value


def test_the_bag_is_what_the_manifest_says():
    (entry,) = [entry for entry in MANIFEST if entry["file"] == BAG.name]
    assert hashlib.sha256(BAG.read_bytes()).hexdigest() == entry["sha256"]
    assert BAG.stat().st_size < 5e6
    recording = open_recording(BAG, strict=True)
    assert recording.counts == {name: topic["messages"] for name, topic in entry["topics"].items()}
    assert recording.metadata["poise"]["licence"] == entry["licence"]


def test_one_command_takes_the_sweep_to_its_parts(tmp_path):
    out, answer = tmp_path / "hammer.ply", tmp_path / "hammer.json"
    parts, picture = tmp_path / "parts.ply", tmp_path / "parts.png"
    command = ["scan", str(BAG), "--out", str(out), "--parts", str(parts), "--picture", str(picture)]
    assert run([*command, "--json", str(answer)]) == 0
    result = json.loads(answer.read_text())
    cloud = read_cloud(out)
    assert len(cloud.points) == result["n_points"] == len(result["labels"]) == len(result["seen"])
    assert result["frame"] == "base_link"
    assert result["volume"] == pytest.approx(TRUE_VOLUME, rel=0.3)
    assert result["n_parts"] > 1
    length = np.sort(np.ptp(cloud.points, axis=0))[-1]
    assert length == pytest.approx(0.3, abs=0.03)
    assert parts.stat().st_size > 1000
    assert picture.stat().st_size > 1000
    shape = load_object(out)  # what poise identify --object takes
    assert shape.parts.volumes.sum() == pytest.approx(TRUE_VOLUME, rel=0.3)


@pytest.mark.parametrize("frames", [15, 20, 30, 60])
def test_a_hole_in_the_sampling_of_the_handle_is_no_opening(frames):
    """Through a gap between the 2,500 points that are kept, the ball would hollow the handle out to half the volume."""
    found = scan_sweep(read_sweep(open_recording(BAG), SweepOptions(frames=frames)), ScanOptions()).segmented()
    assert found.solid.volume == pytest.approx(TRUE_VOLUME, abs=2 * found.solid.volume_std)
    assert found.solid.volume == pytest.approx(TRUE_VOLUME, rel=0.15 if frames >= 20 else 0.25)  # few see its underside


def test_a_hand_eye_transform_can_be_given_instead(tmp_path):
    bag = copied(tmp_path / "bare.mcap", without=["tf_static"])
    error = refusal(bag)
    assert error.code == ErrorCode.FRAME_UNKNOWN
    assert "hand_eye" in error.message
    pose = [0.075, 0.0, 0.02, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
    given = Mounting.of_vector("link_eef", "camera", pose)
    one = read_sweep(open_recording(bag), SweepOptions(hand_eye=given, frames=3))
    two = read_sweep(open_recording(BAG), SweepOptions(frames=3))
    for a, b in zip(one.views, two.views, strict=True):
        np.testing.assert_allclose(a.translation_world_camera, b.translation_world_camera, atol=1e-9)
        np.testing.assert_allclose(a.rotation_world_camera, b.rotation_world_camera, atol=1e-9)
    assert run(["scan", str(bag), "--hand-eye", "link_eef 1 2"]) == 2
    assert run(["scan", str(bag), "--hand-eye", "no_link " + " ".join(map(str, pose))]) == 2


@pytest.mark.parametrize(
    ("without", "code", "word"),
    [
        ([INFO], ErrorCode.TOPIC_MISSING, "camera_info"),
        ([DEPTH], ErrorCode.TOPIC_MISSING, "has no depth"),
        (["robot_description"], ErrorCode.ROBOT_DESCRIPTION_MISSING, "URDF"),
        (["joint_states"], ErrorCode.TOPIC_MISSING, "joint_states"),
    ],
)
def test_what_a_bag_lacks_is_named(tmp_path, without, code, word):
    error = refusal(copied(tmp_path / "lacks.mcap", without=without))
    assert error.code == code
    assert word in error.message


def test_colours_may_be_missing_in_the_bag(tmp_path):
    sweep = read_sweep(
        open_recording(copied(tmp_path / "grey.mcap", without=["camera/color/image_raw"])), SweepOptions()
    )
    assert all(view.frame.colours is None for view in sweep.views)


def test_frames_in_a_gap_of_the_joint_states_are_marked(tmp_path):
    def silent(message):
        return None if message.topic == "joint_states" and 2e9 < message.log_time < 3e9 else message.data

    sweep = read_sweep(open_recording(copied(tmp_path / "gap.mcap", silent)), SweepOptions())
    stamps = np.array([view.frame.stamp for view in sweep.views])
    sure = np.array([view.sure for view in sweep.views])
    np.testing.assert_array_equal(sure, ~((stamps > 2.001e9) & (stamps < 2.999e9)))
    assert any("gaps" in note for note in sweep.notes)


def test_joint_states_of_another_time_are_refused(tmp_path):
    bag = copied(tmp_path / "late.mcap", lambda message: None if message.topic == "joint_states" else message.data)
    assert refusal(bag).code in (ErrorCode.TOPIC_MISSING, ErrorCode.EMPTY)


def test_fewer_frames_are_spread_over_the_sweep():
    stamps = [view.frame.stamp for view in read_sweep(open_recording(BAG), SweepOptions(frames=5)).views]
    assert len(stamps) == 5
    assert np.ptp(np.diff(stamps)) <= 0.25e9


def test_camera_info_of_another_size_is_refused(tmp_path):
    def shrunk(message):
        if message.topic != INFO:
            return message.data
        data = bytearray(message.data)
        at = data.index((240).to_bytes(4, "little") + (320).to_bytes(4, "little"))
        data[at : at + 4] = (120).to_bytes(4, "little")
        return bytes(data)

    error = refusal(copied(tmp_path / "small.mcap", shrunk))
    assert error.code == ErrorCode.TYPE_MISMATCH
    assert "320 x 240" in error.message
