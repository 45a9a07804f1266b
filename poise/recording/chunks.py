"""The heads of chunk records: where a payload lies and what it should decompress to."""

import struct
from dataclasses import dataclass
from typing import BinaryIO

from mcap.records import ChunkIndex

from poise.recording.blocks import RECORD_HEAD

_CHUNK_HEAD = struct.Struct("<QQQI")  # start, end, decompressed length, checksum
_LONGEST_NAME = 16  # of a compression


@dataclass(frozen=True)
class ChunkHead:
    """What precedes the payload of a chunk.

    Args:
        record: offset of the chunk record.
        payload: offset of the payload.
        size: bytes of the payload.
        compression: "", "lz4" or "zstd".
        length: bytes when decompressed.
        crc: CRC-32 of the decompressed bytes; 0 when the writer left none.
        start: least log time, ns.
        end: greatest log time, ns.
        count: how many messages; None when unknown.
    """

    record: int
    payload: int
    size: int
    compression: str
    length: int
    crc: int
    start: int
    end: int
    count: int | None


def head_size(compression: str) -> int:
    """Return how many bytes of a chunk record come before its payload."""
    return RECORD_HEAD.size + _CHUNK_HEAD.size + 4 + len(compression.encode()) + 8


def indexed_head(file: BinaryIO, index: ChunkIndex) -> ChunkHead:
    """Take everything but the payload's checksum from the index, which has its own checksum."""
    file.seek(index.chunk_start_offset + RECORD_HEAD.size)
    _, _, _, crc = _CHUNK_HEAD.unpack(file.read(_CHUNK_HEAD.size))
    return ChunkHead(
        record=index.chunk_start_offset,
        payload=index.chunk_start_offset + head_size(index.compression),
        size=index.compressed_size,
        compression=index.compression,
        length=index.uncompressed_size,
        crc=crc,
        start=index.message_start_time,
        end=index.message_end_time,
        count=_count_messages(index),
    )


def read_head(file: BinaryIO, record: int, length: int) -> ChunkHead | None:
    """Read a chunk's own head; None when it is cut off or contradicts the record's length."""
    file.seek(record + RECORD_HEAD.size)
    head = file.read(min(length, _CHUNK_HEAD.size + 4 + _LONGEST_NAME + 8))
    try:
        start, end, decompressed, crc = _CHUNK_HEAD.unpack_from(head)
        (name_length,) = struct.unpack_from("<I", head, _CHUNK_HEAD.size)
        name = head[_CHUNK_HEAD.size + 4 :][: min(name_length, _LONGEST_NAME)].decode("ascii")
        (size,) = struct.unpack_from("<Q", head, _CHUNK_HEAD.size + 4 + len(name))
    except (struct.error, UnicodeDecodeError):
        return None
    payload = record + head_size(name)
    if payload + size != record + RECORD_HEAD.size + length:
        return None
    return ChunkHead(record, payload, size, name, decompressed, crc, start, end, None)


def _count_messages(index: ChunkIndex) -> int | None:
    """Count the messages of a chunk by the sizes of the message indexes behind it; None when it has none."""
    if not index.message_index_offsets:
        return None
    offsets = sorted(index.message_index_offsets.values())
    ends = [*offsets[1:], index.chunk_start_offset + index.chunk_length + index.message_index_length]
    # a record head, the channel, the length of the list, then 16 bytes a message
    counts = [(end - start - RECORD_HEAD.size - 6) // 16 for start, end in zip(offsets, ends, strict=True)]
    return sum(counts) if min(counts) >= 0 else None
