"""Recordings of every format give the same streams: rosbag2 with both storages and compressions, ROS 1 bags."""

import re
import shutil
import sqlite3
import struct

import numpy as np
import pytest
import zstandard
from other_formats import JAZZY, NOETIC, write_ros1, write_rosbag2, write_splits
from rosbags.rosbag1 import Writer as Writer1
from test_bag_bad_input import refused

from poise.errors import ErrorCode, InputError
from poise.recording import (
    JointStream,
    LossKind,
    RecordingWriter,
    find_recordings,
    open_recording,
    rewrite_recording,
    skipped_entries,
    write_recording,
)
from poise.recording.images import image_of, messages_of

WRITERS = {
    "db3": lambda bag, folder: write_rosbag2(bag, folder / "bag", "db3"),
    "mcap folder": lambda bag, folder: write_rosbag2(bag, folder / "bag", "mcap"),
    "db3, files compressed": lambda bag, folder: write_rosbag2(bag, folder / "bag", "db3", "FILE"),
    "mcap, files compressed": lambda bag, folder: write_rosbag2(bag, folder / "bag", "mcap", "FILE"),
    "db3, messages compressed": lambda bag, folder: write_rosbag2(bag, folder / "bag", "db3", "MESSAGE"),
    "db3 splits": lambda bag, folder: write_splits(bag, folder / "bag", "db3"),
    "mcap splits": lambda bag, folder: write_splits(bag, folder / "bag", "mcap"),
    "ROS 1": lambda bag, folder: write_ros1(bag, folder / "run.bag"),
    "ROS 1, bz2": lambda bag, folder: write_ros1(bag, folder / "run.bag", "BZ2"),
    "ROS 1, lz4": lambda bag, folder: write_ros1(bag, folder / "run.bag", "LZ4"),
}


def all_streams(recording):
    return [
        recording.wrench(),
        recording.joint_states(),
        recording.joint_states(names=("c", "a")),
        recording.poses("ft_sensor", "base"),
        recording.poses("imu"),
        recording.imu(),
        recording.odometry(),
    ]


def assert_equal(first, second):
    """Hold two recordings against each other, stream by stream and number by number."""
    for one, other in zip(all_streams(first), all_streams(second), strict=True):
        for name, values in one.arrays().items():
            np.testing.assert_array_equal(values, other.arrays()[name], err_msg=name)
    assert first.robot_description() == second.robot_description()


@pytest.fixture(scope="session")
def written(bag, tmp_path_factory):
    """The path of the sample recording in each format."""
    return {name: write(bag, tmp_path_factory.mktemp("formats")) for name, write in WRITERS.items()}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_streams_of_the_mcap_file(bag, written, name):
    recording = open_recording(written[name], strict=True)
    whole = open_recording(bag)
    assert_equal(recording, whole)
    assert {key.strip("/"): count for key, count in recording.counts.items()} == whole.counts
    times = [message.log_time for message in recording.messages()]
    assert times == [message.log_time for message in whole.messages()]
    assert recording.unchecked == (0 if name == "ROS 1, bz2" else sum(whole.counts.values()))  # rosbags writes none


@pytest.mark.parametrize("name", ["db3", "db3, files compressed", "ROS 1"])
def test_a_single_file_is_read_like_its_folder(bag, written, name):
    path = written[name]
    file = next(entry for entry in path.iterdir() if entry.name != "metadata.yaml") if path.is_dir() else path
    assert_equal(open_recording(file), open_recording(bag))


@pytest.mark.parametrize("name", ["db3", "ROS 1, lz4", "db3, messages compressed"])
def test_any_format_can_be_written_again_as_mcap(bag, written, name, tmp_path):
    recording = open_recording(written[name])
    rewrite_recording(recording, tmp_path / "again.mcap", {"wrench": recording.wrench()})
    again = open_recording(tmp_path / "again.mcap", strict=True)
    assert_equal(again, open_recording(bag))
    assert "float64[] effort" in again.topic("joint_states").definition


def test_an_unpacked_file_is_deleted_with_its_recording(written):
    recording = open_recording(written["db3, files compressed"])
    unpacked = recording._blocks[0][0].path
    assert unpacked.exists()
    del recording
    assert not unpacked.exists()


def test_a_message_with_a_sequence_number_is_converted(tmp_path):
    header = NOETIC.types["std_msgs/msg/Header"]
    time = NOETIC.types["builtin_interfaces/msg/Time"]
    joint_state = NOETIC.types["sensor_msgs/msg/JointState"]
    with Writer1(tmp_path / "run.bag") as writer:
        connection = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=NOETIC)
        for number in range(3):
            stamp = header(seq=4_000_000_000 + number, stamp=time(sec=7, nanosec=number), frame_id="frame")
            message = joint_state(stamp, ["a"], np.array([1.0]), np.array([]), np.array([3.0]))
            data = NOETIC.serialize_ros1(message, "sensor_msgs/msg/JointState")
            writer.write(connection, 8_000_000_000 + number, data)
    joints = open_recording(tmp_path / "run.bag").joint_states()
    assert joints.stamps.tolist() == [7_000_000_000, 7_000_000_001, 7_000_000_002]
    assert joints.effort.tolist() == [[3.0]] * 3
    assert np.isnan(joints.velocity).all()


def test_messages_of_unknown_types_are_skipped_and_listed(bag, tmp_path):
    path = tmp_path / "run.bag"
    store = NOETIC
    with Writer1(path) as writer:
        known = writer.add_connection("/robot_description", "std_msgs/msg/String", typestore=store)
        own = writer.add_connection("/gripper", "my_msgs/msg/Grip", msgdef="float64 width\n", md5sum="0" * 32)
        text = NOETIC.types["std_msgs/msg/String"]("<robot/>")
        writer.write(known, 1, store.serialize_ros1(text, "std_msgs/msg/String"))
        writer.write(own, 2, struct.pack("<d", 0.1))
    recording = open_recording(path)
    assert recording.topics == {"/robot_description": "std_msgs/msg/String"}
    (loss,) = recording.losses
    assert loss.kind == LossKind.UNSUPPORTED
    assert loss.messages == 1
    assert "/gripper (my_msgs/Grip)" in loss.sentence


@pytest.mark.parametrize("name", ["db3", "ROS 1"])
def test_images_are_read_from_every_format(tmp_path, name):
    make = JAZZY.types
    header = make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](sec=5, nanosec=6), "camera")
    pixels = np.arange(12, dtype=np.uint16)
    image = make["sensor_msgs/msg/Image"](header, 3, 4, "16UC1", 0, 8, pixels.view(np.uint8))
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        writer.add_topic("image", "sensor_msgs/msg/Image")
        writer.write("image", 7, bytes(JAZZY.serialize_cdr(image, "sensor_msgs/msg/Image")))
    (message,) = messages_of(open_recording(WRITERS[name](tmp_path / "run.mcap", tmp_path)), "image")
    found = image_of(message, "image")
    assert (found.stamp, found.frame_id) == (5_000_000_006, "camera")
    np.testing.assert_array_equal(found.pixels.ravel(), pixels)


def test_the_recordings_of_a_folder_are_found(written, tmp_path, bag):
    for name in ("one.mcap", "two.db3", "three.bag", "notes.txt"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "metadata.yaml").write_text("")
    (tmp_path / "other").mkdir()
    names = [path.name for path in find_recordings(tmp_path)]
    assert names == ["folder", "one.mcap", "three.bag", "two.db3"]
    assert find_recordings(written["db3 splits"]) == [written["db3 splits"]]
    assert skipped_entries(tmp_path, find_recordings(tmp_path)) == ["notes.txt", "other/"]


def test_a_folder_that_a_killed_recorder_left_is_a_recording(bag, tmp_path):
    (tmp_path / "runs").mkdir()
    folder = write_splits(bag, tmp_path / "runs" / "one", "mcap")
    (folder / "metadata.yaml").unlink()
    assert folder in find_recordings(folder.parent)
    assert skipped_entries(folder, [folder]) == []


def test_recordings_that_do_not_belong_together_are_not_read_as_one(bag, tmp_path):
    for name in ("left", "right_0"):
        shutil.copy(bag, tmp_path / f"{name}.mcap")
    with pytest.raises(InputError, match=r"2 recordings \(left.mcap, right_0.mcap\): name one of them") as caught:
        open_recording(tmp_path)
    assert caught.value.code is ErrorCode.BAD_INPUT
    assert [path.name for path in find_recordings(tmp_path)] == ["left.mcap", "right_0.mcap"]


# -- damage ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def long_bag(tmp_path_factory):
    """A recording of 3,000 joint states."""
    path = tmp_path_factory.mktemp("long") / "long.mcap"
    stamps = np.arange(1, 3001) * 1_000_000
    values = np.random.default_rng(3).normal(size=(3000, 6))
    write_recording(path, {"joint_states": JointStream(stamps, tuple("abcdef"), values, values, values)})
    return path


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_cut_db3_gives_what_is_before_the_cut(long_bag, tmp_path, share):
    folder = write_rosbag2(long_bag, tmp_path / "bag", "db3")
    file = next(folder.glob("*.db3"))
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    recording = open_recording(file)
    (loss,) = recording.losses
    assert loss.kind == LossKind.TRUNCATED
    joints, whole = recording.joint_states(), open_recording(long_bag).joint_states()
    assert 0.6 * share < len(joints) / len(whole) < 1
    np.testing.assert_array_equal(joints.effort, whole.effort[: len(joints)])
    refused(lambda: open_recording(file, strict=True), ErrorCode.FILE_CORRUPT, file, "cannot be read")


def test_a_damaged_page_of_a_db3_costs_its_own_messages(long_bag, tmp_path):
    folder = write_rosbag2(long_bag, tmp_path / "bag", "db3")
    file = next(folder.glob("*.db3"))
    content = bytearray(file.read_bytes())
    page = 4096
    middle = len(content) // page // 2 * page
    content[middle : middle + page] = bytes(page)
    file.write_bytes(content)
    recording = open_recording(file)
    (loss,) = recording.losses
    assert loss.kind == LossKind.DAMAGED
    assert 1 <= loss.messages <= 20
    assert recording.counts["joint_states"] + loss.messages == 3000
    whole = {(stamp, tuple(row)) for stamp, row in zip(*stamped_rows(open_recording(long_bag)), strict=True)}
    assert set(zip(*stamped_rows(recording), strict=True)) < whole


def stamped_rows(recording):
    joints = recording.joint_states()
    return joints.stamps.tolist(), [tuple(row) for row in joints.effort.tolist()]


@pytest.mark.parametrize("compression", ["none", "LZ4"])
@pytest.mark.parametrize("share", [0.2, 0.7])
def test_a_cut_ros1_bag_gives_what_is_before_the_cut(long_bag, tmp_path, share, compression):
    path = write_ros1(long_bag, tmp_path / "run.bag", compression)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    recording = open_recording(path)
    assert any(loss.kind == LossKind.TRUNCATED for loss in recording.losses)
    joints, whole = recording.joint_states(), open_recording(long_bag).joint_states()
    np.testing.assert_array_equal(joints.effort, whole.effort[: len(joints)])
    assert 0.5 * share < len(joints) / len(whole) < 1


def test_a_cut_bz2_chunk_is_whole_or_nothing(long_bag, tmp_path):
    path = write_ros1(long_bag, tmp_path / "run.bag", "BZ2")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    refused(lambda: open_recording(path), ErrorCode.FILE_CORRUPT, path, "gives no message", "cut or damaged")


def test_damage_between_the_chunks_of_a_ros1_bag_costs_one_chunk(tmp_path):
    path = write_chunks(tmp_path / "run.bag", 5)
    content = bytearray(path.read_bytes())
    starts = [match.start() for match in re.finditer(b"op=\x05", content)]
    content[starts[2] : starts[2] + 4] = b"damn"
    path.write_bytes(content)
    recording = open_recording(path)
    assert recording.counts == {"/robot_description": 4}
    assert [loss.kind for loss in recording.losses] == [LossKind.DAMAGED]


def write_chunks(path, count):
    """A ROS 1 bag with one message a chunk."""
    text = NOETIC.types["std_msgs/msg/String"]("x" * (1 << 20))
    data = NOETIC.serialize_ros1(text, "std_msgs/msg/String")
    with Writer1(path) as writer:
        connection = writer.add_connection("/robot_description", "std_msgs/msg/String", typestore=NOETIC)
        for stamp in range(count):
            writer.write(connection, stamp, data)
    return path


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ("DROP TABLE messages", "without rosbag2's table 'messages'"),
        ("ALTER TABLE topics RENAME COLUMN type TO kind", "lacks type"),
        (
            "DROP TABLE messages; CREATE VIEW messages AS"
            " WITH RECURSIVE c(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM c)"
            " SELECT id, 1 AS topic_id, id AS timestamp, zeroblob(100) AS data FROM c",
            "without rosbag2's table 'messages'",
        ),
    ],
)
def test_another_schema_is_refused(long_bag, tmp_path, change, word):
    folder = write_rosbag2(long_bag, tmp_path / "bag", "db3")
    file = next(folder.glob("*.db3"))
    database = sqlite3.connect(file)
    database.executescript(change)
    database.close()
    refused(lambda: open_recording(folder), ErrorCode.FILE_CORRUPT, file, word)


def test_rows_of_no_topic_are_skipped_and_counted(long_bag, tmp_path):
    folder = write_rosbag2(long_bag, tmp_path / "bag", "db3")
    database = sqlite3.connect(next(folder.glob("*.db3")))
    database.execute("UPDATE messages SET topic_id = 77 WHERE id % 100 = 0")
    database.execute("UPDATE messages SET data = 'text' WHERE id = 1")
    database.commit()
    database.close()
    recording = open_recording(folder)
    assert recording.losses[0].messages == 31
    assert len(recording.joint_states()) == 3000 - 31


def test_a_folder_without_metadata_gives_its_files_by_their_names(bag, tmp_path):
    folder = write_splits(bag, tmp_path / "bag", "db3")
    (folder / "metadata.yaml").unlink()
    recording = open_recording(folder)
    assert_equal(recording, open_recording(bag))
    assert "metadata.yaml is missing" in recording.losses[0].sentence


def test_a_journal_that_a_killed_recorder_left_is_read(long_bag, tmp_path):
    folder = write_rosbag2(long_bag, tmp_path / "bag", "db3")
    file = next(folder.glob("*.db3"))
    database = sqlite3.connect(file, isolation_level=None)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("PRAGMA wal_autocheckpoint=0")
    database.execute("INSERT INTO messages SELECT id + 3000, topic_id, timestamp + 3000000000, data FROM messages")
    for name in (file.name, file.name + "-wal"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    database.close()
    assert sum(open_recording(tmp_path / file.name).counts.values()) == 6000


# -- zstd -----------------------------------------------------------------------------------------------------


def test_a_cut_compressed_file_gives_what_is_before_the_cut(long_bag, tmp_path):
    folder = write_rosbag2(long_bag, tmp_path / "bag", "db3", "FILE")
    file = next(folder.glob("*.zstd"))
    content = file.read_bytes()
    file.write_bytes(content[: len(content) * 2 // 3])
    recording = open_recording(folder)
    assert recording.losses[0].kind == LossKind.TRUNCATED
    assert 500 < len(recording.joint_states()) < 3000


def test_a_compressed_file_that_is_cut_at_once_is_refused(long_bag, tmp_path):
    path = tmp_path / "run.db3.zstd"
    path.write_bytes(zstandard.ZstdCompressor().compress(long_bag.read_bytes())[:20])
    refused(lambda: open_recording(path), ErrorCode.FILE_CORRUPT, path, "first zstd block")


def test_a_damaged_compressed_file_is_refused(long_bag, tmp_path):
    file = tmp_path / "long.mcap.zstd"
    content = bytearray(zstandard.ZstdCompressor(write_checksum=True).compress(long_bag.read_bytes()))
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    refused(lambda: open_recording(file), ErrorCode.FILE_CORRUPT, file, "zstd frame", "copy it again")


def test_damaged_compressed_messages_are_skipped_and_counted(long_bag, tmp_path):
    folder = write_rosbag2(long_bag, tmp_path / "bag", "db3", "MESSAGE")
    database = sqlite3.connect(next(folder.glob("*.db3")))
    database.execute("UPDATE messages SET data = substr(data, 1, length(data) - 9) WHERE id IN (5, 6, 7)")
    database.commit()
    database.close()
    recording = open_recording(folder)
    assert recording.losses[0].messages == 3
    assert len(recording.joint_states()) == 2997


@pytest.mark.parametrize("how", ["file", "message"])
def test_a_small_file_that_unpacks_to_much_is_refused(long_bag, tmp_path, how):
    zeros = zstandard.ZstdCompressor().compress(bytes(80 << 20))
    if how == "file":
        path = tmp_path / "bomb.db3.zstd"
        path.write_bytes(zeros)
        refused(lambda: open_recording(path), ErrorCode.UNSUPPORTED, path, "unpacks from")
        return
    folder = write_rosbag2(long_bag, tmp_path / "bag", "db3", "MESSAGE")
    database = sqlite3.connect(next(folder.glob("*.db3")))
    database.execute("UPDATE messages SET data = ? WHERE id < 10", (zeros,))
    database.commit()
    database.close()
    recording = open_recording(folder)
    assert recording.losses[0].messages == 9


def test_a_ros1_chunk_that_claims_too_much_is_not_unpacked(long_bag, tmp_path):
    path = write_ros1(long_bag, tmp_path / "run.bag", "LZ4")
    content = bytearray(path.read_bytes())
    at = content.index(b"op=\x05")
    size = content.index(b"size=", at - 60) + 5
    content[size : size + 4] = struct.pack("<I", 2**32 - 1)
    path.write_bytes(content)
    refused(lambda: open_recording(path), ErrorCode.FILE_CORRUPT, path, "claims an impossible size")
