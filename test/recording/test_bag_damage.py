"""Damaged bags: every intact message is given, every damage is reported, nothing hangs."""

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from bag_reference import chunk_offsets, judge, messages_before, write_sample
from mcap.writer import Writer

from poise.errors import ErrorCode, InputError
from poise.recording import Loss, LossKind, open_recording, scan

COMPRESSIONS = ("none", "lz4", "zstd")


@pytest.fixture(scope="module", params=COMPRESSIONS)
def sample(request, tmp_path_factory):
    """A whole bag: its bytes, and where damaged copies may go."""
    folder = tmp_path_factory.mktemp(request.param)
    return write_sample(folder / "whole.mcap", request.param), folder / "damaged.mcap"


def truth_of(content: bytes, path: Path) -> Counter:
    path.write_bytes(content)
    return Counter(open_recording(path, strict=True).messages())


def read(path: Path) -> tuple[Counter, tuple[Loss, ...]]:
    """Return the messages and the losses of a bag, of one that gives no message too."""
    try:
        recording = open_recording(path)
    except InputError as error:
        if error.code != ErrorCode.FILE_CORRUPT:
            raise
        return Counter(), error.data["losses"]
    return Counter(recording.messages()), recording.losses


def test_a_truncated_bag_gives_every_intact_message(sample):
    content, path = sample
    rng = np.random.default_rng(1)
    for cut in (9, len(content) // 2, len(content) - 1, *rng.integers(8, len(content), 37)):
        expected = messages_before(content, int(cut))
        path.write_bytes(content[:cut])
        found, losses = read(path)
        assert Counter((message.log_time, message.data) for message in found.elements()) == expected, f"cut at {cut}"
        assert losses, f"cut at {cut}: the loss is not reported"


def test_a_truncated_bag_says_what_was_lost(sample):
    content, path = sample
    path.write_bytes(content[: len(content) // 2])
    recording = open_recording(path)
    (loss,) = recording.losses
    last = max(message.log_time for message in recording.messages())
    assert loss.kind == LossKind.TRUNCATED
    assert loss.start_stamp is not None
    assert loss.start_stamp <= last
    assert path.name in loss.sentence


def test_a_bag_without_its_closing_part_loses_nothing(sample):
    content, path = sample
    truth = truth_of(content, path)
    path.write_bytes(content[:-20])
    recording = open_recording(path)
    assert Counter(recording.messages()) == truth
    assert [loss.kind for loss in recording.losses] == [LossKind.INDEX]


def test_no_flipped_bit_passes_silently(sample):
    content, path = sample
    truth = truth_of(content, path)
    rng = np.random.default_rng(2)
    verdicts = Counter()
    for bit in rng.integers(0, 8 * len(content), 60):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(damaged)
        verdict = judge(path, truth)
        assert verdict in ("error", "loss"), f"bit {bit} of {8 * len(content)}: {verdict}"
        verdicts[verdict] += 1
    assert verdicts["loss"] > 40, "most of a damaged bag is still to be had"


def test_no_flipped_bit_in_heads_index_and_footer_passes_silently(sample):
    content, path = sample
    truth = truth_of(content, path)
    summary_start = int.from_bytes(content[-28:-20], "little")
    first_chunk = chunk_offsets(content)[0]
    places = {
        "magic, header and metadata": (0, first_chunk),
        "chunk head": (first_chunk, first_chunk + 60),
        "message index and summary": (summary_start - 200, len(content)),
    }
    rng = np.random.default_rng(3)
    for start, end in places.values():
        for bit in rng.integers(8 * start, 8 * end, 25):
            damaged = bytearray(content)
            damaged[bit // 8] ^= 1 << (bit % 8)
            path.write_bytes(damaged)
            assert judge(path, truth) in ("error", "loss"), f"bit {bit}"


def test_overwritten_stretches_neither_hang_nor_invent_messages(sample):
    content, path = sample
    truth = truth_of(content, path)
    rng = np.random.default_rng(4)
    for _ in range(30):
        start = int(rng.integers(0, len(content)))
        length = int(rng.choice([8, 300, 70_000]))
        damaged = bytearray(content)
        damaged[start : start + length] = rng.bytes(len(damaged[start : start + length]))
        path.write_bytes(damaged)
        assert judge(path, truth) in ("error", "loss")


def test_a_damaged_chunk_costs_only_its_own_messages_and_is_told_with_span_and_count(sample):
    content, path = sample
    truth = truth_of(content, path)
    intact = open_recording(path)
    middle = intact._blocks[1][0]
    damaged = bytearray(content)
    damaged[middle.offset + middle.size // 2] ^= 1
    path.write_bytes(damaged)
    recording = open_recording(path)
    lost = truth - Counter(recording.messages())
    (loss,) = [loss for loss in recording.losses if loss.kind == LossKind.DAMAGED]
    assert loss.messages == lost.total() == len(middle.messages)
    assert loss.start_stamp == min(message.log_time for message in lost)
    assert loss.end_stamp == max(message.log_time for message in lost)
    assert f"{loss.messages} messages" in loss.sentence
    assert str(loss.start_stamp) in loss.sentence
    assert recording.metadata == intact.metadata, "the metadata has a checksum of its own"


def test_strict_reading_refuses_any_damage(sample):
    content, path = sample
    path.write_bytes(content[:-20])
    with pytest.raises(InputError, match="copy it again") as caught:
        open_recording(path, strict=True)
    assert caught.value.code == ErrorCode.FILE_CORRUPT


def test_altered_metadata_is_not_given(sample):
    content, path = sample
    path.write_bytes(content.replace(b"9.82085", b"1.82085"))
    recording = open_recording(path)
    assert recording.metadata == {}
    assert [loss.kind for loss in recording.losses] == [LossKind.METADATA]


def test_a_corrupt_length_is_a_loss_not_an_allocation(sample):
    content, path = sample
    chunk = chunk_offsets(content)[0]
    huge = (1 << 62).to_bytes(8, "little")
    # without the closing part the reader has to believe the chunk's own head
    for at in (chunk + 1, chunk + 9 + 16):
        damaged = bytearray(content[:-20])
        damaged[at : at + 8] = huge
        path.write_bytes(damaged)
        _, losses = read(path)
        assert any(loss.kind in (LossKind.DAMAGED, LossKind.TRUNCATED) for loss in losses)


@pytest.fixture
def without_chunks(tmp_path, monkeypatch):
    """Make a bag whose messages stand outside of chunks, as the `fastwrite` preset of rosbag2 records."""
    monkeypatch.setattr(scan, "RUN_SIZE", 10_000)  # so that a small bag is read in several runs

    def write(**options: bool) -> tuple[bytes, Path]:
        path = tmp_path / "bag.mcap"
        with path.open("wb") as file:
            writer = Writer(file, use_chunking=False, **options)
            writer.start("ros2")
            channel = writer.register_channel("raw", "cdr", writer.register_schema("our_msgs/msg/Own", "ros2msg", b""))
            for stamp in range(1000):
                writer.add_message(channel, log_time=stamp, publish_time=stamp, data=bytes(stamp % 50))
            writer.finish()
        return path.read_bytes(), path

    return write


@pytest.mark.parametrize("checked", [True, False])
def test_a_bag_without_chunks_is_read_whole_or_as_far_as_it_goes(without_chunks, checked):
    content, path = without_chunks(enable_data_crcs=checked)
    recording = open_recording(path, strict=True)
    expected = [(stamp, "raw", bytes(stamp % 50)) for stamp in range(1000)]
    assert list(recording.messages()) == expected
    assert recording.unchecked == (0 if checked else 1000)
    for cut in (len(content) // 3, len(content) // 2):
        path.write_bytes(content[:cut])
        recording = open_recording(path)
        found = list(recording.messages())
        assert found == expected[: len(found)]
        assert sum(31 + len(message.data) for message in found) > cut - 300, "every message before the cut"
        assert [loss.kind for loss in recording.losses] == [LossKind.TRUNCATED]


def test_messages_outside_of_chunks_whose_checksum_fails_are_not_given(without_chunks):
    content, path = without_chunks(enable_data_crcs=True)
    damaged = bytearray(content)
    damaged[len(content) // 2] ^= 1
    path.write_bytes(damaged)
    with pytest.raises(InputError, match="cannot be trusted") as caught:
        open_recording(path)
    assert caught.value.code == ErrorCode.FILE_CORRUPT
    assert sum(loss.messages or 0 for loss in caught.value.data["losses"]) > 900


def test_a_broken_length_outside_of_chunks_is_a_loss_even_without_any_checksum(without_chunks):
    content, path = without_chunks(enable_crcs=False, use_statistics=False)
    at = content.index(b"\x05" + (22 + 30).to_bytes(8, "little"), len(content) // 2)  # the length of a message
    damaged = bytearray(content)
    damaged[at + 4] = 255
    path.write_bytes(damaged)
    recording = open_recording(path)
    assert [loss.kind for loss in recording.losses] == [LossKind.DAMAGED]
    assert [message.log_time for message in recording.messages()] == list(range(recording.counts["raw"]))


def test_a_file_that_changes_while_it_is_read_is_an_error(sample):
    content, path = sample
    path.write_bytes(content)
    recording = open_recording(path)
    damaged = bytearray(content)
    block = recording._blocks[0][0]
    damaged[block.offset + block.size // 2] ^= 1
    path.write_bytes(damaged)
    with pytest.raises(InputError, match=re.escape("changed while")) as caught:
        recording.wrench()
    assert caught.value.code == ErrorCode.FILE_CORRUPT
