"""Damaged bags: every intact message is given, every damage is told, nothing hangs."""

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from bag_reference import chunk_offsets, judge, messages_before, write_sample

from poise.errors import ErrorCode, InputError
from poise.recording import Loss, LossKind, open_recording

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
        assert losses, f"cut at {cut}: the loss is not told"


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
