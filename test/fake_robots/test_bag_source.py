"""A bag as a source: the very bytes, on relative names, and a word about what cannot be replayed."""

from pathlib import Path

import pytest

from poise.errors import ErrorCode, InputError
from poise.fake_robots.bag_replay import BagSource
from poise.recording import RecordingWriter, open_recording
from poise.recording.encoding import encode_text

BAG = Path(__file__).parents[2] / "bags" / "kuka_at_rest.mcap"
TEXT = "std_msgs/msg/String"


def write(path, *topics):
    with RecordingWriter(path) as writer:
        for topic, type_name, metadata in topics:
            writer.add_topic(topic, type_name, definition="string data", metadata=metadata)
            for stamp in (1, 2):
                writer.write(topic, stamp * 10**9, encode_text(f"{topic} {stamp}"))
    return path


def test_every_message_comes_in_order_with_its_bytes():
    source, recording = BagSource(BAG), open_recording(BAG)
    ours = [(message.time, message.topic, message.data) for message in source.messages()]
    assert ours == [(m.log_time, m.topic.strip("/"), m.data) for m in recording.messages()]
    assert ours == [(m.time, m.topic, m.data) for m in source.messages()]  # and again from the beginning


def test_only_the_topics_that_were_asked_for(tmp_path):
    path = write(tmp_path / "a.mcap", ("/robot/a", TEXT, None), ("/robot/b", TEXT, None))
    assert list(BagSource(path, ["b"]).topics) == ["robot/b"]
    with pytest.raises(InputError) as caught:
        BagSource(path, ["c"])
    assert caught.value.code is ErrorCode.TOPIC_MISSING


def test_what_was_latched_is_latched(tmp_path):
    profile = "- durability: {}\n"
    path = write(
        tmp_path / "a.mcap",
        ("/tf_static", TEXT, None),
        ("/ns/robot_description", TEXT, None),
        ("/map", TEXT, {"offered_qos_profiles": profile.format("transient_local")}),
        ("/old_map", TEXT, {"offered_qos_profiles": profile.format(1)}),
        ("/wrench", TEXT, {"offered_qos_profiles": profile.format("volatile")}),
        ("/odd", TEXT, {"offered_qos_profiles": "{"}),
    )
    latched = {name for name, info in BagSource(path).topics.items() if info.latched}
    assert latched == {"tf_static", "ns/robot_description", "map", "old_map"}


def test_a_type_that_is_not_installed_is_left_out_and_told_or_refused(tmp_path):
    path = write(
        tmp_path / "a.mcap", ("/a", TEXT, None), ("/b", "ghost_msgs/msg/Ghost", None), ("/c", "os/msg/x.y", None)
    )
    source = BagSource(path)
    assert list(source.topics) == ["a"]
    assert [message.topic for message in source.messages()] == ["a", "a"]
    assert any("ghost_msgs/msg/Ghost is not installed" in remark for remark in source.remarks)
    with pytest.raises(InputError, match="ghost_msgs") as caught:
        BagSource(path, refuse_unknown=True)
    assert caught.value.code is ErrorCode.UNSUPPORTED


def test_a_bag_of_nothing_that_can_be_replayed_is_refused(tmp_path):
    with pytest.raises(InputError, match="no topic can be replayed"):
        BagSource(write(tmp_path / "a.mcap", ("/b", "ghost_msgs/msg/Ghost", None)))


def test_losses_of_a_damaged_bag_are_told(tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(BAG.read_bytes()[:-2000])
    assert BagSource(cut).remarks
