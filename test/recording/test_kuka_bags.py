"""The committed bags are what their manifest says, and what the converter makes of the published files."""

import hashlib
import importlib.util
import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml

from poise.errors import ErrorCode, InputError
from poise.recording import open_recording, resample

ROOT = Path(__file__).parents[2]
BAGS = ROOT / "bags"
MANIFEST = yaml.safe_load((BAGS / "manifest.yaml").read_text())["bags"]
KUKA = [entry for entry in MANIFEST if entry["file"].startswith("kuka")]
CSV_FOLDER = os.environ.get("POISE_KUKA_CSV")  # the published files; tests that need them are skipped without
G = 9.82085


@pytest.fixture(scope="module")
def converter():
    spec = importlib.util.spec_from_file_location("converter", ROOT / "tools" / "convert_kuka_recording.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_manifest_lists_every_bag_and_no_other():
    assert {entry["file"] for entry in MANIFEST} == {path.name for path in BAGS.glob("*.mcap")}


@pytest.mark.parametrize("entry", KUKA, ids=lambda entry: entry["file"])
def test_a_bag_is_what_the_manifest_says(entry):
    path = BAGS / entry["file"]
    assert hashlib.sha256(path.read_bytes()).hexdigest() == entry["sha256"]
    recording = open_recording(path, strict=True)
    assert recording.unchecked == 0
    assert recording.topics == {name: topic["type"] for name, topic in entry["topics"].items()}
    assert recording.counts == {name: topic["messages"] for name, topic in entry["topics"].items()}
    assert float(recording.metadata["poise"]["gravity"]) == entry["gravity"] == G
    assert "10.5281/zenodo.11096791" in entry["attribution"]
    assert entry["licence"] == recording.metadata["poise"]["licence"] == "CC BY 4.0"
    for name, stream in (("wrench", recording.wrench()), ("imu", recording.imu())):
        rate = (len(stream) - 1) / (stream.seconds[-1] - stream.seconds[0])
        assert rate == pytest.approx(entry["topics"][name]["rate"], abs=0.06)
        assert stream.not_finite == 0
        assert recording.reordered[name] == 0


def static_poses():
    """Wrench (24, 6), gravity in the sensor frame (24, 3), specific force in the sensor frame (24, 3)."""
    recording = open_recording(BAGS / "kuka_static_poses.mcap")
    wrench, imu = recording.wrench(), recording.imu()
    poses, reason = resample(recording.poses("ft_sensor", "base"), wrench.stamps, max_gap=0.9)
    assert not reason.any()
    gravity = poses.rotation_parent_child.transpose(0, 2, 1) @ [0.0, 0.0, -G]
    rotation_sensor_imu = recording.poses("imu", "ft_sensor").rotation_parent_child[0]
    return wrench.wrench_in_sensor, gravity, imu.linear_acceleration @ rotation_sensor_imu.T


def test_the_static_poses_weigh_what_is_known_of_the_payload():
    wrench, gravity, _ = static_poses()
    A = np.concatenate([gravity.reshape(-1, 1), np.tile(np.eye(3), (24, 1))], axis=1)
    solution, residual, *_ = np.linalg.lstsq(A, wrench[:, :3].ravel(), rcond=None)
    np.testing.assert_allclose(solution, [0.9323, 9.08, -1.02, 9.98], atol=0.005)
    assert np.sqrt(residual[0] / 72) == pytest.approx(0.087, abs=0.001)


def test_the_accelerometer_points_against_gravity_in_every_pose():
    _, gravity, specific_force = static_poses()
    error = specific_force + gravity
    assert np.abs(error - error.mean(axis=0)).max() < 0.02 * G
    assert np.abs(error.mean(axis=0)).max() < 0.08 * G  # its own bias


def test_no_static_pose_moves_during_its_dwell():
    poses = open_recording(BAGS / "kuka_static_poses.mcap").poses("ft_sensor")
    assert len(poses) == 48
    np.testing.assert_array_equal(poses.rotation_parent_child[::2], poses.rotation_parent_child[1::2])
    np.testing.assert_array_equal(np.diff(poses.stamps)[::2], 800_000_000)


@pytest.mark.parametrize("entry", KUKA, ids=lambda entry: entry["file"])
def test_orientations_are_rotations_and_say_nothing_of_position(entry):
    if "tf" not in entry["topics"]:
        pytest.skip("no orientation was recorded at rest")
    poses = open_recording(BAGS / entry["file"]).poses("ft_sensor")
    R = poses.rotation_parent_child
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-14)
    assert (np.linalg.det(R) > 0).all()
    assert not poses.translation_parent_child.any()
    assert "no position" in entry["notes"]


# -- the converter ------------------------------------------------------------------------------------------------


@pytest.fixture
def csv_folder(tmp_path):
    """Small files with the published names and columns."""
    rng = np.random.default_rng(0)
    wrench, acceleration = "fx,fy,fz,tx,ty,tz", "ax,ay,az"
    rotation = "r11,r12,r13,r21,r22,r23,r31,r32,r33"
    turn = np.eye(3).ravel()

    def write(name, header, rows):
        lines = [",".join(f"{value:.17g}" for value in row) for row in rows]
        (tmp_path / name).write_text("\n".join([header, *lines]))

    def times(period):
        return 1_708_857_503_900_001 + np.arange(5)[:, None] * period

    turns = np.tile(turn, (5, 1))
    write(
        "0-calibration_fts-accel.csv",
        f"{wrench},{acceleration},gx,gy,gz,{rotation}",
        np.hstack([rng.normal(size=(5, 12)), turns]),
    )
    write("0-steady-state_wrench.csv", wrench, rng.normal(size=(5, 6)))
    write("0-steady-state_accel.csv", acceleration, rng.normal(size=(5, 3)))
    for prefix in ("1-baseline", "2-vibrations"):
        write(f"{prefix}_wrench.csv", f"t,{wrench}", np.hstack([times(1433), rng.normal(size=(5, 6))]))
        write(f"{prefix}_accel.csv", f"t,{acceleration}", np.hstack([times(3935), rng.normal(size=(5, 3))]))
        write(f"{prefix}_orientations.csv", f"t,{rotation}", np.hstack([times(10_000), turns]))
    return tmp_path


def test_converting_keeps_every_value_and_time(converter, csv_folder, tmp_path_factory):
    output = tmp_path_factory.mktemp("bags")
    converter.convert(csv_folder, output)
    table = np.genfromtxt(csv_folder / "1-baseline_wrench.csv", delimiter=",", names=True)
    read = open_recording(output / "kuka_free_motion.mcap", strict=True).wrench()
    np.testing.assert_array_equal(read.stamps, table["t"].astype(np.int64) * 1000)
    np.testing.assert_array_equal(read.wrench_in_sensor[:, 1], table["fy"])
    imu = np.genfromtxt(csv_folder / "0-steady-state_accel.csv", delimiter=",", names=True)
    at_rest = open_recording(output / "kuka_at_rest.mcap", strict=True)
    np.testing.assert_allclose(at_rest.imu().linear_acceleration[:, 2], imu["az"] * 9.80665)
    assert np.isnan(at_rest.imu().angular_velocity).all(), "there is no gyroscope"
    np.testing.assert_allclose(at_rest.wrench().seconds, np.arange(5) / 700, atol=1e-9)


def test_converting_twice_gives_the_same_bytes(converter, csv_folder, tmp_path_factory):
    one, two = tmp_path_factory.mktemp("one"), tmp_path_factory.mktemp("two")
    converter.convert(csv_folder, one)
    converter.convert(csv_folder, two)
    assert len(list(one.iterdir())) == 5
    for path in one.iterdir():
        assert path.read_bytes() == (two / path.name).read_bytes()


def test_what_is_wrong_with_the_files_is_said(converter, csv_folder, tmp_path_factory):
    output = tmp_path_factory.mktemp("bags")
    cases = [
        ("1-baseline_wrench.csv", None, ErrorCode.FILE_UNREADABLE),
        ("0-steady-state_accel.csv", "ax,ay\n1,2", ErrorCode.FILE_CORRUPT),
        ("0-steady-state_accel.csv", "ax,ay,az", ErrorCode.FILE_CORRUPT),
        ("0-steady-state_accel.csv", "ax,ay,az\n1,2,nan", ErrorCode.FILE_CORRUPT),
        ("0-steady-state_accel.csv", "ax,ay,az\n1,2,3\n1,2", ErrorCode.FILE_CORRUPT),
        ("0-steady-state_accel.csv", "", ErrorCode.FILE_CORRUPT),
    ]
    for name, text, code in cases:
        path = csv_folder / name
        kept = path.read_text()
        path.unlink() if text is None else path.write_text(text)
        with pytest.raises(InputError) as caught:
            converter.convert(csv_folder, output)
        assert caught.value.code == code
        assert name in caught.value.message
        assert not (output / "manifest.yaml").exists()
        path.write_text(kept)


@pytest.mark.skipif(CSV_FOLDER is None, reason="POISE_KUKA_CSV does not name the folder of the published files")
def test_the_committed_bags_come_from_the_published_files(converter, tmp_path):
    converter.convert(Path(CSV_FOLDER), tmp_path)
    made = yaml.safe_load((tmp_path / "manifest.yaml").read_text())["bags"]
    for ours, committed in zip(made, KUKA, strict=True):
        name = committed["file"]
        one, other = open_recording(tmp_path / name, strict=True), open_recording(BAGS / name, strict=True)
        # message by message: another version of zstd may compress to other bytes
        assert Counter(one.messages()) == Counter(other.messages())
        assert one.metadata == other.metadata
        assert {**ours, "sha256": ""} == {**committed, "sha256": ""}
