"""The closing part of an mcap file: checksum of the data section, index of its chunks, topics, counts, footer."""

import zlib
from dataclasses import dataclass, field
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

from poise.recording.blocks import MCAP_MAGIC, RECORD_HEAD, DamagedRecordError, parse_record
from poise.recording.chunks import head_size

_FOOTER_SIZE = RECORD_HEAD.size + 20
DATA_END_SIZE = RECORD_HEAD.size + 4
_SUMMARY_RECORDS: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics,
    Opcode.CHUNK_INDEX: ChunkIndex,
}


@dataclass
class Ending:
    """What the end of a file says about the rest; empty when it cannot be trusted.

    Args:
        data_end: offset of the record that closes the data section; None when the end is missing or damaged.
        chunks: the indexed chunks by their offset.
    """

    data_end: int | None = None
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: dict[int, ChunkIndex] = field(default_factory=dict)
    statistics: Statistics | None = None


def read_ending(file: BinaryIO, size: int) -> Ending:
    """Read and check the summary and the footer of a file of this size.

    The index of a writer that left no checksum is taken only where every chunk is found at its place.
    """
    footer_at = size - len(MCAP_MAGIC) - _FOOTER_SIZE
    if footer_at < len(MCAP_MAGIC) + DATA_END_SIZE:
        return Ending()
    file.seek(footer_at)
    tail = file.read(_FOOTER_SIZE + len(MCAP_MAGIC))
    if not tail.startswith(RECORD_HEAD.pack(Opcode.FOOTER, 20)) or not tail.endswith(MCAP_MAGIC):
        return Ending()
    footer: Footer = parse_record(Footer, tail[RECORD_HEAD.size : _FOOTER_SIZE])
    start = footer.summary_start or footer_at
    if not len(MCAP_MAGIC) + DATA_END_SIZE <= start <= footer_at:
        return Ending()
    file.seek(start)
    summary = file.read(footer_at - start)
    covered = summary + tail[: _FOOTER_SIZE - 4]
    if footer.summary_crc and zlib.crc32(covered) != footer.summary_crc:
        return Ending()
    ending = Ending(data_end=start - DATA_END_SIZE)
    try:
        _read_summary(summary, ending)
    except DamagedRecordError:
        return Ending()
    if not _chunks_fit(ending) or (not footer.summary_crc and not _chunks_are_there(file, ending.chunks)):
        return Ending()
    return ending


def _read_summary(summary: bytes, ending: Ending) -> None:
    position = 0
    while position < len(summary):
        if position + RECORD_HEAD.size > len(summary):
            raise DamagedRecordError("the summary ends in the middle of a record")
        opcode, length = RECORD_HEAD.unpack_from(summary, position)
        position += RECORD_HEAD.size + length
        if position > len(summary):
            raise DamagedRecordError("a record of the summary is longer than the summary")
        if opcode not in _SUMMARY_RECORDS:
            continue
        record = parse_record(_SUMMARY_RECORDS[opcode], summary[position - length : position])
        if isinstance(record, Schema):
            ending.schemas[record.id] = record
        elif isinstance(record, Channel):
            ending.channels[record.id] = record
        elif isinstance(record, ChunkIndex):
            ending.chunks[record.chunk_start_offset] = record
        else:
            ending.statistics = record


def _chunks_fit(ending: Ending) -> bool:
    """Whether the indexed chunks follow each other inside the data section."""
    behind = len(MCAP_MAGIC)
    for offset, chunk in sorted(ending.chunks.items()):
        if offset < behind or chunk.compressed_size + head_size(chunk.compression) != chunk.chunk_length:
            return False
        behind = offset + chunk.chunk_length
    return ending.data_end is not None and behind <= ending.data_end


def _chunks_are_there(file: BinaryIO, chunks: dict[int, ChunkIndex]) -> bool:
    for offset, chunk in chunks.items():
        file.seek(offset)
        if file.read(RECORD_HEAD.size) != RECORD_HEAD.pack(Opcode.CHUNK, chunk.chunk_length - RECORD_HEAD.size):
            return False
    return True
