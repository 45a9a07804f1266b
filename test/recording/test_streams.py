"""Streams are values: shapes checked, arrays frozen, stamps rising; late messages are put in their place."""

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.recording import JointStream, WrenchStream, open_recording, write_recording
from poise.recording.timeline import MAX_LATENESS, in_time_order

MS = 1_000_000


def test_a_stream_cannot_be_changed_from_outside():
    values = np.zeros((3, 6))
    stream = WrenchStream(np.arange(3), values, "ft")
    values[0] = 1
    assert (stream.wrench_in_sensor == 0).all()
    with pytest.raises(ValueError, match="read-only"):
        stream.wrench_in_sensor[0] = 1


@pytest.mark.parametrize(
    ("code", "stamps", "values"),
    [
        (ErrorCode.TYPE_MISMATCH, np.arange(3), np.zeros((3, 5))),
        (ErrorCode.TYPE_MISMATCH, np.arange(3), np.zeros((2, 6))),
        (ErrorCode.TYPE_MISMATCH, np.arange(3.0), np.zeros((3, 6))),
        (ErrorCode.TYPE_MISMATCH, np.zeros((3, 1), dtype=int), np.zeros((3, 6))),
        (ErrorCode.TYPE_MISMATCH, np.arange(3), [["x"] * 6] * 3),
        (ErrorCode.TIME_BACKWARDS, np.array([2, 1, 3]), np.zeros((3, 6))),
    ],
)
def test_a_stream_of_the_wrong_shape_type_or_order_is_refused(code, stamps, values):
    with pytest.raises(InputError) as caught:
        WrenchStream(stamps, values, "ft")
    assert caught.value.code == code


def test_selecting_keeps_what_belongs_together():
    stream = WrenchStream(np.arange(5), np.arange(30.0).reshape(5, 6), "ft")
    some = stream.select(stream.stamps % 2 == 0)
    assert some.stamps.tolist() == [0, 2, 4]
    assert some.wrench_in_sensor[:, 0].tolist() == [0, 12, 24]
    assert stream.select(slice(1, 3)).seconds.tolist() == [0.0, 1e-9]


@pytest.mark.parametrize("seed", range(5))
def test_messages_that_a_network_delayed_are_put_in_their_place_and_counted(seed):
    rng = np.random.default_rng(seed)
    stamps = np.arange(1000) * MS + rng.integers(0, MS // 2, 1000)
    arrival = np.argsort(stamps + rng.exponential(3 * MS, 1000), kind="stable")
    arrived = stamps[arrival]
    order, late = in_time_order(arrived, "wrench")
    np.testing.assert_array_equal(arrived[order], stamps)
    assert late == (arrived < np.maximum.accumulate(arrived)).sum()
    assert late > 0


def test_messages_in_order_stay_as_they_are():
    order, late = in_time_order(np.array([1, 2, 2, 5]), "wrench")
    assert order.tolist() == [0, 1, 2, 3]
    assert late == 0


@pytest.mark.parametrize("back", [3 * MS, 40 * MS, MAX_LATENESS + 10 * MS, 3600 * 1000 * MS])
def test_a_clock_that_was_set_back_is_refused_with_the_place(back):
    stamps = np.arange(1000) * MS
    stamps[600:] -= back
    with pytest.raises(InputError, match=r"wrench: the stamps go back .* at message 600 ") as caught:
        in_time_order(stamps, "wrench")
    assert caught.value.code == ErrorCode.TIME_BACKWARDS
    assert caught.value.data["index"] == 600


def test_a_message_later_than_any_network_delays_is_refused():
    stamps = np.arange(1000) * MS
    stamps[500] = stamps[499] - MAX_LATENESS - 1
    with pytest.raises(InputError) as caught:
        in_time_order(stamps, "wrench")
    assert caught.value.data["index"] == 500


def test_arrays_that_are_stored_column_by_column_are_written_and_read(tmp_path):
    values = np.asfortranarray(np.random.default_rng(1).normal(size=(10, 3)))
    stream = JointStream(np.arange(10) * MS, ("a", "b", "c"), values, values, values)
    write_recording(tmp_path / "joints.mcap", {"joint_states": stream})
    read = open_recording(tmp_path / "joints.mcap").joint_states()
    np.testing.assert_array_equal(read.effort, values)
