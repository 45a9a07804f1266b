"""Faults do what they say to the messages they name, the same for the same seed, and nothing to the others."""

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.fake_robots.faults import apply_faults, parse_faults
from poise.fake_robots.stream import CLOCK, Message, clock_bytes, with_clock
from poise.recording.encoding import encode_stream, typestore
from poise.recording.streams import JointStream, WrenchStream

MILLI = 10**6
TYPES = {
    "wrench": "geometry_msgs/msg/WrenchStamped",
    "joint_states": "sensor_msgs/msg/JointState",
    "custom": "some_msgs/msg/Unknown",
    CLOCK: "rosgraph_msgs/msg/Clock",
}


@pytest.fixture(scope="module")
def messages():
    """Two seconds of wrench at 100 Hz and joint states at 50 Hz, from stamp 10 s."""
    start = 10 * 10**9
    stamps = start + np.arange(200) * 10 * MILLI
    wrench = np.column_stack([np.arange(200.0), np.zeros((200, 4)), -np.arange(200.0)])
    one, absent = np.ones((100, 1)), np.full((100, 1), np.nan)
    streams = {
        "wrench": WrenchStream(stamps, wrench, "ft_sensor"),
        "joint_states": JointStream(stamps[::2], ("a",), one, one, absent),
    }
    made = [Message(t, topic, data) for topic, stream in streams.items() for t, data in encode_stream(topic, stream)]
    return sorted(made, key=lambda message: message.time)


def strike(messages, *lines, seed=1):
    return list(apply_faults(iter(messages), parse_faults(lines), TYPES, seed))


def of(messages, topic):
    return [message for message in messages if message.topic == topic]


def read(message):
    return typestore().deserialize_cdr(message.data, TYPES[message.topic])


def seconds(message):
    return (message.time - 10 * 10**9) * 1e-9


def test_drop_loses_its_share_of_one_topic_and_leaves_the_other(messages):
    left = strike(messages, "drop: {topic: wrench, share: 0.2}")
    assert 130 < len(of(left, "wrench")) < 190
    assert of(left, "joint_states") == of(messages, "joint_states")


def test_a_topic_falls_silent_for_an_interval(messages):
    left = of(strike(messages, "drop: {topic: wrench, start: 0.5, end: 1.0}"), "wrench")
    assert [seconds(message) for message in left if 0.5 <= seconds(message) < 1.0] == []
    assert len(left) == 150


def test_delay_keeps_bytes_and_comes_out_in_the_order_of_arrival(messages):
    late = strike(messages, "delay: {topic: wrench, seconds: 0.03, jitter: 0.05}")
    assert sorted(message.data for message in late) == sorted(message.data for message in messages)
    assert [message.time for message in late] == sorted(message.time for message in late)
    before = {message.data: message.time for message in of(messages, "wrench")}
    delays = [(message.time - before[message.data]) * 1e-9 for message in of(late, "wrench")]
    assert 0.03 <= min(delays) < max(delays) < 0.08


def test_nan_spoils_every_number_but_the_stamp(messages):
    spoilt = strike(messages, "nan: {topic: joint_states, start: 1.0}")
    for old, new in zip(of(messages, "joint_states"), of(spoilt, "joint_states"), strict=True):
        content = read(new)
        assert content.header == read(old).header
        assert np.isnan(content.position).all() == (seconds(new) >= 1.0)


def test_saturate_stops_at_the_range(messages):
    clipped = [read(message).wrench for message in of(strike(messages, "saturate: {force: 50, torque: 20}"), "wrench")]
    assert max(wrench.force.x for wrench in clipped) == 50.0
    assert min(wrench.torque.z for wrench in clipped) == -20.0
    assert clipped[10].force.x == 10.0


def test_reorder_lets_messages_be_overtaken_and_loses_none(messages):
    mixed = of(strike(messages, "reorder: {topic: wrench, share: 0.1, depth: 3}"), "wrench")
    order = [of(messages, "wrench").index(next(m for m in messages if m.data == message.data)) for message in mixed]
    assert sorted(order) == list(range(200))
    assert order != sorted(order)
    assert max(position - index for index, position in enumerate(order)) <= 3
    assert [message.time for message in mixed] == sorted(message.time for message in mixed)


def test_a_time_jump_moves_stamps_and_clock_alike(messages):
    jumped = strike(list(with_clock(messages, 10.0)), "time_jump: {seconds: -3.5, start: 1.0}")
    for message in of(jumped, "wrench"):
        stamp = read(message).header.stamp
        expected = message.time - (3_500 * MILLI if seconds(message) >= 1.0 else 0)
        assert stamp.sec * 10**9 + stamp.nanosec == expected
    clock = [read(message).clock for message in of(jumped, CLOCK)]
    assert (clock[9].sec, clock[10].sec, clock[10].nanosec) == (10, 7, 5 * 10**8)


def test_one_seed_strikes_the_same_messages_and_faults_stack(messages):
    lines = ("drop: {share: 0.3}", "nan: {topic: wrench, share: 0.5}", "reorder: {share: 0.2, depth: 2}")
    first, again, other = (strike(messages, *lines, seed=seed) for seed in (1, 1, 2))
    assert [(m.time, m.topic) for m in first] == [(m.time, m.topic) for m in again]
    assert [m.time for m in first] != [m.time for m in other]
    assert len(first) < len(messages)


def test_types_that_cannot_be_read_pass_through():
    message = Message(0, "custom", b"\x00\x01\x00\x00????")
    assert strike([message], "nan", "saturate", "time_jump: {seconds: 1}") == [message]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("explode", "expected one of"),
        ("drop: {topik: wrench}", "drop takes"),
        ("drop: {share: lots}", "must be a number"),
        ("delay: {seconds: -1}", "must not be negative"),
        ("{drop: {}, nan: {}}", "expected one of"),
        ("[", "not YAML"),
    ],
)
def test_a_fault_that_is_not_understood_is_refused(line, why):
    with pytest.raises(InputError, match=why) as caught:
        parse_faults([line])
    assert caught.value.code is ErrorCode.BAD_INPUT


def test_the_clock_ticks_between_messages_and_before_the_first():
    ticked = list(with_clock([Message(10**9, "a", b""), Message(10**9 + 35 * MILLI, "a", b"")], 100.0))
    assert [(m.time - 10**9) // MILLI for m in ticked if m.topic == CLOCK] == [0, 10, 20, 30]
    assert ticked[0].topic == CLOCK
    clock = typestore().deserialize_cdr(clock_bytes(12_000_000_345), "rosgraph_msgs/msg/Clock").clock
    assert (clock.sec, clock.nanosec) == (12, 345)
