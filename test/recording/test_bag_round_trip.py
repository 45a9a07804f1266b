"""Bags come back as they were written, through our reader and through those of others."""

import dataclasses

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from poise.recording import RecordingWriter, WrenchStream, open_recording, write_recording

STORE = get_typestore(Stores.ROS2_JAZZY)
LATCHED = QosDurability.TRANSIENT_LOCAL
COUNTS = {"wrench": 400, "joint_states": 40, "tf": 40, "tf_static": 1, "imu": 40, "odom": 40, "robot_description": 1}


def assert_same(one, other, tolerance=0.0):
    """Hold two streams against each other, field by field."""
    for field in dataclasses.fields(one):
        first, second = getattr(one, field.name), getattr(other, field.name)
        if isinstance(first, np.ndarray):
            np.testing.assert_allclose(second, first, rtol=0, atol=tolerance, equal_nan=True)
        else:
            assert first == second


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_every_stream_comes_back_as_written(streams, tmp_path, compression):
    path = tmp_path / "bag.mcap"
    write_recording(path, streams, robot_description="<robot/>", compression=compression)
    recording = open_recording(path, strict=True)
    assert_same(streams["wrench"], recording.wrench())
    assert_same(streams["joint_states"], recording.joint_states())
    assert_same(streams["imu"], recording.imu())
    assert_same(streams["tf"], recording.poses("ft_sensor"), 1e-14)
    assert_same(streams["tf_static"], recording.poses("imu", "ft_sensor"), 1e-14)
    assert_same(streams["odom"], recording.odometry(), 1e-14)
    assert recording.robot_description() == "<robot/>"
    assert recording.unchecked == 0


def test_metadata_comes_back_as_written(bag):
    assert open_recording(bag).metadata == {"poise": {"gravity": "9.82085"}}


def test_writing_twice_gives_the_same_bytes(streams, tmp_path):
    for name in ("one", "two"):
        write_recording(tmp_path / name, streams, metadata={"poise": {"gravity": "9.82085"}})
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_rosbags_reads_our_bags(bag, streams):
    with AnyReader([bag]) as reader:
        assert {topic: info.msgcount for topic, info in reader.topics.items()} == COUNTS
        wrenches = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages() if c.topic == "wrench"]
        latched = {c.topic for c in reader.connections if c.ext.offered_qos_profiles[0].durability == LATCHED}
    force = [[w.wrench.force.x, w.wrench.force.y, w.wrench.force.z] for w in wrenches]
    np.testing.assert_array_equal(force, streams["wrench"].wrench_in_sensor[:, :3])
    stamps = [w.header.stamp.sec * 10**9 + w.header.stamp.nanosec for w in wrenches]
    np.testing.assert_array_equal(stamps, streams["wrench"].stamps)
    assert latched == {"tf_static", "robot_description"}


def test_mcap_ros2_reads_our_bags_by_their_own_definitions(bag, streams):
    decoder = pytest.importorskip("mcap_ros2.decoder")
    with bag.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        decoded = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
    assert {topic: sum(1 for name, _ in decoded if name == topic) for topic in COUNTS} == COUNTS
    joints = [message for topic, message in decoded if topic == "joint_states"]
    np.testing.assert_array_equal([message.velocity for message in joints], streams["joint_states"].velocity)
    assert all(len(message.effort) == 0 for message in joints)
    (static,) = [message.transforms[0] for topic, message in decoded if topic == "tf_static"]
    assert (static.header.frame_id, static.child_frame_id) == ("ft_sensor", "imu")


def test_our_bags_carry_the_type_hashes_that_ros_carries(bag):
    published = {"geometry_msgs/msg/WrenchStamped": "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"}
    topic = open_recording(bag).topic("wrench")
    assert dict(topic.metadata)["topic_type_hash"] == "RIHS01_" + published[topic.type]


def write_with_rosbags(folder, messages):
    """Write (topic, type, log time, message) as a rosbag2 folder."""
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for topic, kind, log_time, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], log_time, STORE.serialize_cdr(message, kind))


def joint_state(stamp, names, values):
    types = STORE.types
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    header = types["std_msgs/msg/Header"](stamp=time, frame_id="")
    values, nothing = np.array(values, dtype=float), np.zeros(0)
    return types["sensor_msgs/msg/JointState"](
        header=header, name=names, position=values, velocity=nothing, effort=nothing
    )


def test_a_rosbag2_folder_of_others_is_read_and_said_to_be_unchecked(tmp_path):
    kind = "sensor_msgs/msg/JointState"
    messages = [("/joint_states", kind, i, joint_state(i, ["a", "b"], [i, -i])) for i in range(100)]
    write_with_rosbags(tmp_path / "folder", messages)
    recording = open_recording(tmp_path / "folder", strict=True)
    stream = recording.joint_states()
    np.testing.assert_array_equal(stream.position, [[i, -i] for i in range(100)])
    assert np.isnan(stream.velocity).all()
    assert recording.unchecked == 100, "rosbags writes no checksums"


def test_joints_in_another_order_come_in_the_columns_of_their_names(tmp_path):
    kind = "sensor_msgs/msg/JointState"
    messages = []
    for i in range(10):
        names, values = (["a", "b"], [i, -i]) if i % 2 == 0 else (["b", "a"], [-i, i])
        messages.append(("/joint_states", kind, i, joint_state(i, names, values)))
    write_with_rosbags(tmp_path / "folder", messages)
    recording = open_recording(tmp_path / "folder")
    np.testing.assert_array_equal(recording.joint_states().position, [[i, -i] for i in range(10)])
    np.testing.assert_array_equal(recording.joint_states(names=["b"]).position, [[-i] for i in range(10)])


def test_any_topic_passes_raw_with_its_definition(bag, streams, tmp_path):
    recording = open_recording(bag)
    extra = "float64 value\n"
    with RecordingWriter(tmp_path / "copy.mcap", compression="lz4") as writer:
        writer.add_topic("own", "our_msgs/msg/Own", definition=extra)
        for name in recording.topics:
            topic = recording.topic(name)
            writer.add_topic(name, topic.type, definition=topic.definition, metadata=dict(topic.metadata))
        for message in recording.messages():
            writer.write(message.topic, message.log_time, message.data)
        writer.write("own", 7, b"\0\1\0\0" + np.float64(2.5).tobytes())
    copy = open_recording(tmp_path / "copy.mcap", strict=True)
    assert copy.topic("own").definition == extra
    assert [message.data[4:] for message in copy.messages(["own"])] == [np.float64(2.5).tobytes()]
    assert list(copy.messages(recording.topics)) == list(recording.messages())
    assert_same(streams["wrench"], copy.wrench())


def test_raw_messages_come_in_the_order_of_their_log_times(bag):
    times = [message.log_time for message in open_recording(bag).messages()]
    assert times == sorted(times)
    assert len(times) == sum(COUNTS.values())


def test_a_bag_in_several_files_is_one_recording(streams, tmp_path):
    wrench = streams["wrench"]
    listed = []
    for number, part in enumerate((slice(0, 150), slice(150, 400))):
        listed.append(f"part_{number}.mcap")
        write_recording(tmp_path / listed[-1], {"/wrench": wrench.select(part)})
    names = ", ".join(listed)
    (tmp_path / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information: {{storage_identifier: mcap, relative_file_paths: [{names}]}}"
    )
    recording = open_recording(tmp_path, strict=True)
    assert_same(wrench, recording.wrench())
    (tmp_path / "metadata.yaml").unlink()
    killed = open_recording(tmp_path)
    assert_same(wrench, killed.wrench())
    assert "metadata.yaml is missing" in killed.losses[0].sentence


def test_values_that_are_not_finite_are_kept_and_counted(streams, tmp_path):
    values = streams["wrench"].wrench_in_sensor.copy()
    values[3, 2], values[5, 0] = np.nan, np.inf
    write_recording(tmp_path / "bag", {"wrench": WrenchStream(streams["wrench"].stamps, values, "ft_sensor")})
    read = open_recording(tmp_path / "bag").wrench()
    assert read.not_finite == 2
    np.testing.assert_array_equal(read.wrench_in_sensor, values)


def test_what_was_never_measured_does_not_count_as_not_finite(streams):
    assert streams["joint_states"].not_finite == 0
    assert streams["imu"].not_finite == 0
