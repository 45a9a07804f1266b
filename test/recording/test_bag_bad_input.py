"""What is wrong with a bag is said in one sentence: what, where, how to fix it."""

import os
import tracemalloc

import numpy as np
import pytest
from mcap.writer import Writer

from poise.errors import ErrorCode, InputError
from poise.recording import (
    JointStream,
    LossKind,
    PoseStream,
    RecordingWriter,
    WrenchStream,
    open_recording,
    write_recording,
)
from poise.recording.blocks import MESSAGE_HEAD, split_records
from poise.recording.encoding import encode_stream

WRENCH = "geometry_msgs/msg/WrenchStamped"


def wrenches(stamps, frame_id="ft_sensor"):
    return WrenchStream(np.array(stamps), np.zeros((len(stamps), 6)), frame_id)


def refused(call, code, *words):
    """Hold the error of a call against its code and the words that its sentence must have."""
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.code == code, caught.value.message
    for word in words:
        assert str(word) in caught.value.message
    assert "\n" not in caught.value.message
    return caught.value


def test_a_path_without_a_bag_is_refused(tmp_path):
    refused(lambda: open_recording(tmp_path / "none.mcap"), ErrorCode.FILE_UNREADABLE, "none.mcap", "check the name")
    refused(lambda: open_recording(tmp_path), ErrorCode.FILE_UNREADABLE, tmp_path, "without a bag")
    os.mkfifo(tmp_path / "pipe.mcap")  # opening it would wait for a writer for ever
    refused(lambda: open_recording(tmp_path / "pipe.mcap"), ErrorCode.FILE_UNREADABLE, "is not a file")


@pytest.mark.parametrize("what", ["bag", "folder"])
def test_no_permission_is_said(bag, tmp_path, what):
    path = tmp_path / "bag.mcap"
    path.write_bytes(bag.read_bytes())
    target = path if what == "bag" else tmp_path
    user = os.geteuid()
    target.chmod(0)
    try:
        if user == 0:
            os.seteuid(65534)  # root may read everything: drop its rights for a moment
        error = refused(lambda: open_recording(path), ErrorCode.FILE_UNREADABLE, path, "Permission denied")
    finally:
        os.seteuid(user)
        target.chmod(0o700)
    assert error.exit_status == 2


@pytest.mark.parametrize(
    ("content", "code", "word"),
    [
        (b"", ErrorCode.EMPTY, "empty file"),
        (b"fx,fy,fz\n1,2,3\n", ErrorCode.FILE_CORRUPT, "is not a recording: give an .mcap"),
        (b"SQLite format 3\0" + bytes(4096), ErrorCode.FILE_CORRUPT, "without rosbag2's table"),
        (b"\x89MCAP0\r\n", ErrorCode.FILE_CORRUPT, "gives no message"),
    ],
)
def test_a_file_that_is_no_bag_is_refused(tmp_path, content, code, word):
    path = tmp_path / "file.mcap"
    path.write_bytes(content)
    refused(lambda: open_recording(path), code, path, word)


def test_a_bag_without_messages_is_refused(tmp_path):
    path = tmp_path / "bag.mcap"
    with RecordingWriter(path) as writer:
        writer.add_topic("wrench", WRENCH)
    refused(lambda: open_recording(path), ErrorCode.EMPTY, path, "holds no messages")


@pytest.mark.parametrize(
    ("text", "code", "word"),
    [
        ("storage_identifier: leveldb, relative_file_paths: [a]", ErrorCode.UNSUPPORTED, "stored as leveldb"),
        (
            "storage_identifier: mcap, compression_mode: FILE, compression_format: xz, relative_file_paths: [a.xz]",
            ErrorCode.UNSUPPORTED,
            "compressed by xz",
        ),
        ("storage_identifier: mcap, relative_file_paths: [a.mcap]", ErrorCode.FILE_UNREADABLE, "lacks a.mcap"),
        ("storage_identifier: mcap, relative_file_paths: [/etc/passwd]", ErrorCode.FILE_UNREADABLE, "lacks passwd"),
        ("storage_identifier: mcap, relative_file_paths: []", ErrorCode.EMPTY, "lists no files"),
        ("storage_identifier: mcap", ErrorCode.FILE_CORRUPT, "ros2 bag reindex"),
        ("]", ErrorCode.FILE_CORRUPT, "ros2 bag reindex"),
    ],
)
def test_a_folder_that_cannot_be_read_is_refused(tmp_path, text, code, word):
    (tmp_path / "metadata.yaml").write_text(f"rosbag2_bagfile_information: {{{text}}}")
    refused(lambda: open_recording(tmp_path), code, word)


def bomb(path, megabytes: int, chunks: int) -> None:
    """A valid bag of zeros: each chunk unpacks to this many megabytes."""
    with RecordingWriter(path) as writer:
        writer.add_topic("wrench", WRENCH)
        for index in range(chunks):
            writer.write("wrench", index, bytes(megabytes << 20))


@pytest.mark.parametrize(
    ("megabytes", "chunks", "code", "word"),
    [
        (128, 1, ErrorCode.FILE_CORRUPT, "claims an impossible size"),
        (24, 3, ErrorCode.UNSUPPORTED, "unpacks from"),
    ],
)
def test_a_small_bag_that_unpacks_to_much_is_refused_in_bounded_memory(tmp_path, megabytes, chunks, code, word):
    path = tmp_path / "bomb.mcap"
    bomb(path, megabytes, chunks)
    assert path.stat().st_size < 200_000
    tracemalloc.start()
    try:
        refused(lambda: open_recording(path), code, word)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 100 << 20


def test_a_chunk_of_many_empty_messages_takes_little_memory_beside_its_content(tmp_path):
    count = 200_000
    content = MESSAGE_HEAD.pack(5, 22, 1, 0, 7, 7) * count
    tracemalloc.start()
    try:
        messages, _, _ = split_records(content)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(messages) == count
    assert peak < 4 * len(content)


def test_an_unknown_compression_is_named_and_is_no_damage(tmp_path):
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=100, enable_crcs=False)
        writer.start()
        channel = writer.register_channel("wrench", "cdr", writer.register_schema(WRENCH, "ros2msg", b""))
        for stamp in range(10):
            writer.add_message(channel, log_time=stamp, publish_time=stamp, data=bytes(200))
        writer.finish()
    content = path.read_bytes()
    path.write_bytes(content.replace(b"zstd", b"zst2"))
    error = refused(lambda: open_recording(path), ErrorCode.UNSUPPORTED, "compressed by 'zst2'", "mcap compress")
    assert "checksum" not in error.message
    parts = content.split(b"zstd")  # half of them in the chunks, half in the index
    names = [b"zst2" if index % (len(parts) // 2) == 0 else b"zstd" for index in range(len(parts) - 1)]
    path.write_bytes(b"".join(part + name for part, name in zip(parts, [*names, b""], strict=True)))
    assert [loss.kind for loss in open_recording(path).losses] == [LossKind.UNSUPPORTED]


def test_a_missing_topic_is_refused_with_the_topics_that_exist(bag):
    refused(
        lambda: open_recording(bag).wrench("force"),
        ErrorCode.TOPIC_MISSING,
        "has no topic force",
        "wrench (geometry_msgs/msg/WrenchStamped)",
        "imu (sensor_msgs/msg/Imu)",
    )


def test_a_topic_of_another_type_is_refused_with_both_types(bag):
    words = ("imu carries sensor_msgs/msg/Imu, not geometry_msgs/msg/WrenchStamped", "odom (nav_msgs/msg/Odometry)")
    refused(lambda: open_recording(bag).wrench("imu"), ErrorCode.TYPE_MISMATCH, *words)


def test_names_are_found_with_and_without_slash_and_namespace_when_only_one_fits(tmp_path):
    path = tmp_path / "bag.mcap"
    write_recording(path, {"/left/wrench": wrenches([1]), "/left/raw/wrench_2": wrenches([2])})
    recording = open_recording(path)
    for name in ("wrench", "/wrench", "left/wrench", "/left/wrench"):
        assert recording.wrench(name).stamps.tolist() == [1]
    write_recording(path, {"/left/wrench": wrenches([1]), "/right/wrench": wrenches([2])})
    recording = open_recording(path)
    refused(recording.wrench, ErrorCode.TOPIC_MISSING, "several topics wrench", "/left/wrench", "/right/wrench")
    assert recording.wrench("right/wrench").stamps.tolist() == [2]


def test_an_exact_name_wins_over_namespaces(tmp_path):
    path = tmp_path / "bag.mcap"
    write_recording(path, {"wrench": wrenches([1]), "/right/wrench": wrenches([2])})
    assert open_recording(path).wrench().stamps.tolist() == [1]


def test_a_message_that_does_not_decode_is_refused_with_its_number(tmp_path):
    path = tmp_path / "bag.mcap"
    with RecordingWriter(path) as writer:
        writer.add_topic("wrench", WRENCH)
        for stamp, data in encode_stream("wrench", wrenches([1, 2, 3])):
            writer.write("wrench", stamp, data if stamp != 3 else data[:30])
    refused(open_recording(path).wrench, ErrorCode.TYPE_MISMATCH, f"message 2 of wrench is not a {WRENCH}")


def test_another_encoding_than_cdr_is_refused(tmp_path):
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("wrench", "json", writer.register_schema(WRENCH, "jsonschema", b"{}"))
        writer.add_message(channel, log_time=1, publish_time=1, data=b"{}")
        writer.finish()
    refused(open_recording(path).wrench, ErrorCode.UNSUPPORTED, "wrench is encoded as 'json'")


def test_a_sensor_frame_that_changes_on_the_way_is_refused(tmp_path):
    path = tmp_path / "bag.mcap"
    write_recording(path, {"wrench": [wrenches([1]), wrenches([2], "other")]})
    refused(open_recording(path).wrench, ErrorCode.FRAME_UNKNOWN, "wrench: frame_id differs", "ft_sensor, other")


def test_a_clock_set_back_is_refused_and_small_reorderings_are_counted(tmp_path):
    path = tmp_path / "bag.mcap"
    rising = np.arange(100) * 1_000_000

    def write(stamps):
        with RecordingWriter(path) as writer:
            writer.add_topic("wrench", WRENCH)
            for log_time, stamp in enumerate(stamps.tolist()):
                ((_, data),) = encode_stream("wrench", wrenches([stamp]))
                writer.write("wrench", log_time, data)

    swapped = rising.copy()
    swapped[[50, 51]] = swapped[[51, 50]]
    write(swapped)
    recording = open_recording(path)
    assert recording.wrench().stamps.tolist() == rising.tolist()
    assert recording.reordered == {"wrench": 1}
    write(np.concatenate([rising, rising]))
    refused(open_recording(path).wrench, ErrorCode.TIME_BACKWARDS, "wrench", "at message 100", "cut the recording")


def test_a_frame_that_the_bag_does_not_know_is_refused_with_those_it_knows(bag):
    recording = open_recording(bag)
    words = ("no pose of tool", "base -> ft_sensor", "ft_sensor -> imu")
    refused(lambda: recording.poses("tool"), ErrorCode.FRAME_UNKNOWN, *words)
    refused(lambda: recording.poses("ft_sensor", "world"), ErrorCode.FRAME_UNKNOWN, "world -> ft_sensor")


def test_a_frame_with_two_parents_asks_for_one(tmp_path):
    path = tmp_path / "bag.mcap"
    one, two = (
        PoseStream(np.array([i]), np.eye(3)[None], np.zeros((1, 3)), parent, "tool") for i, parent in enumerate("ab")
    )
    write_recording(path, {"tf": [one, two]})
    recording = open_recording(path)
    refused(lambda: recording.poses("tool"), ErrorCode.FRAME_UNKNOWN, "a, b")
    assert recording.poses("tool", "b").stamps.tolist() == [1]


def test_joints_that_are_missing_or_differ_are_refused_by_name(tmp_path):
    path = tmp_path / "bag.mcap"
    arm, hand = (
        JointStream(np.arange(3), names, *[np.zeros((3, len(names)))] * 3) for names in (("a", "b"), ("finger",))
    )
    write_recording(path, {"joint_states": [arm, hand]})
    recording = open_recording(path)
    refused(recording.joint_states, ErrorCode.JOINT_MISSING, "a b", "finger", "say which")
    refused(lambda: recording.joint_states(names=["a", "c"]), ErrorCode.JOINT_MISSING, "a c", "finger")
    assert len(recording.joint_states(names=["finger"])) == 3


def test_a_bag_without_robot_description_says_so(tmp_path):
    path = tmp_path / "bag.mcap"
    write_recording(path, {"wrench": wrenches([1])})
    refused(open_recording(path).robot_description, ErrorCode.ROBOT_DESCRIPTION_MISSING, path, "give a URDF")
