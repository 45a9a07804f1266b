"""Scanning one mcap file from front to back: every checksum checked, every intact message found, every loss named."""

import bisect
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

from poise.errors import ErrorCode, InputError
from poise.recording.blocks import (
    CHUNK_COMPRESSIONS,
    MCAP_MAGIC,
    MESSAGE_HEAD,
    PIECE,
    RECORD_HEAD,
    ChunkBlock,
    DamagedRecordError,
    Loss,
    LossKind,
    MessageRows,
    decompress,
    longest_chunk,
    parse_record,
    split_records,
)
from poise.recording.chunks import ChunkHead, indexed_head, read_head
from poise.recording.contents import Contents, UnpackingBudget
from poise.recording.ending import DATA_END_SIZE, Ending, read_ending
from poise.types import Mask

RUN_SIZE = 4 << 20  # messages outside of chunks are read in runs of about this size
METADATA_CHECK = "crc32"  # the key under which our writer vouches for a metadata record, which mcap does not
_OUTSIDE_RECORDS: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata}


def metadata_checksum(name: str, values: dict[str, str]) -> str:
    """Return the CRC-32, in hexadecimal, of a metadata record's name, keys and values."""
    words = [name, *(word for item in sorted(values.items()) if item[0] != METADATA_CHECK for word in item)]
    return f"{zlib.crc32(chr(0).join(words).encode()):08x}"


def scan(path: Path) -> Contents[ChunkBlock]:
    """Scan an mcap file.

    Raises:
        InputError: FILE_UNREADABLE, EMPTY (no byte in it), FILE_CORRUPT (not an mcap file).
    """
    try:
        if not path.is_file():
            raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} is not a file: give an .mcap file or a bag's folder")
        size = path.stat().st_size
        with path.open("rb") as file:
            return _Scan(path, file, size).run()
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error


class _Scan:
    """The state of one scan."""

    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        self.path, self.file, self.size = path, file, size
        self.contents: Contents[ChunkBlock] = Contents()
        self.ending = Ending()
        self.others: list[tuple[int, int, bytes]] = []  # records outside of chunks: (offset, opcode, content)
        self.run_rows = MessageRows()
        self.run_start = 0
        self.budget = UnpackingBudget(path, size)
        self.data_end: int | None = None  # where the data section was found to end
        self.last_log_time: int | None = None

    def run(self) -> Contents[ChunkBlock]:
        self._check_magic()
        self.ending = read_ending(self.file, self.size)
        self.contents.schemas.update(self.ending.schemas)
        self.contents.channels.update(self.ending.channels)
        position = self._walk(len(MCAP_MAGIC), self.size if self.ending.data_end is None else self.ending.data_end)
        self._flush_run()
        self._judge_ending(position)
        sound = self._data_section_is_sound()
        self._judge_outside(sound)
        if sound is False and not self.contents.losses:
            sentence = "bytes outside of the chunks are damaged, every chunk's checksum holds: no message is lost"
            self._lose(LossKind.INDEX, len(MCAP_MAGIC), sentence, messages=0)
        self._drop_unknown_channels()
        self._compare_counts()
        self.contents.losses.sort(key=lambda loss: loss.offset)
        return self.contents

    def _check_magic(self) -> None:
        magic = self.file.read(len(MCAP_MAGIC))
        if magic == MCAP_MAGIC:
            return
        if not magic:
            raise InputError(ErrorCode.EMPTY, f"{self.path} is an empty file: record again")
        self.file.seek(-min(len(MCAP_MAGIC), self.size), 2)
        if self.file.read() == MCAP_MAGIC:
            raise InputError(ErrorCode.FILE_CORRUPT, f"{self.path} is damaged in its first bytes: copy it again")
        raise InputError(
            ErrorCode.FILE_CORRUPT,
            f"{self.path} is not a recording: give an .mcap, .db3 or ROS 1 .bag file, a rosbag2 folder, or a table with"
            " columns.yaml",
        )

    # -- the walk ---------------------------------------------------------------------------------------------

    def _walk(self, position: int, stop: int) -> int:
        """Go from record to record; where the framing breaks, go on at the next place that the index knows.

        Returns:
            The offset of the first byte that could not be read as a record, or that lies behind the data section.
        """
        chunk_offsets = sorted(self.ending.chunks)
        while position < stop and self.data_end is None:
            if position in self.ending.chunks:
                index = self.ending.chunks[position]
                self._take_chunk(indexed_head(self.file, index))
                position += index.chunk_length
                continue
            following = bisect.bisect_right(chunk_offsets, position)
            boundary = chunk_offsets[following] if following < len(chunk_offsets) else stop
            self.file.seek(position)
            head = self.file.read(RECORD_HEAD.size)
            opcode, length = RECORD_HEAD.unpack(head) if len(head) == RECORD_HEAD.size else (0, 0)
            behind = position + RECORD_HEAD.size + length
            if opcode != 0 and behind <= boundary:
                self._take_record(position, opcode, length)
            elif self.ending.data_end is not None:
                self._lose_stretch(position, boundary)
                behind = boundary
            else:
                if opcode == Opcode.CHUNK and (cut := read_head(self.file, position, length)):
                    self._take_chunk(cut)
                break
            position = behind
        return position

    def _take_record(self, position: int, opcode: int, length: int) -> None:
        """Take one whole record outside of the indexed chunks; its head has just been read."""
        if opcode == Opcode.MESSAGE and length >= MESSAGE_HEAD.size - RECORD_HEAD.size:
            self._take_message(position, length)
        elif opcode == Opcode.CHUNK and (head := read_head(self.file, position, length)):
            self._take_chunk(head)
        elif opcode == Opcode.DATA_END and length == 4 and self.ending.data_end is None:
            self.data_end = position
        elif opcode in _OUTSIDE_RECORDS:
            self.others.append((position, opcode, self.file.read(length)))
        elif opcode in (Opcode.MESSAGE, Opcode.CHUNK, Opcode.DATA_END, Opcode.FOOTER):
            self._lose_record(position, f"the record at byte {position} makes no sense and was skipped")

    def _take_message(self, position: int, length: int) -> None:
        head = RECORD_HEAD.pack(Opcode.MESSAGE, length) + self.file.read(MESSAGE_HEAD.size - RECORD_HEAD.size)
        _, _, channel, _, log_time, _ = MESSAGE_HEAD.unpack(head)
        if self.run_rows and position + length - self.run_start > RUN_SIZE:
            self._flush_run()
        if not self.run_rows:
            self.run_start = position
        size = length + RECORD_HEAD.size - MESSAGE_HEAD.size
        self.run_rows.append((channel, log_time, position + MESSAGE_HEAD.size - self.run_start, size))
        self.last_log_time = log_time

    def _flush_run(self) -> None:
        """Close the run of messages outside of chunks, if there is one."""
        if not self.run_rows:
            return
        self.file.seek(self.run_start)
        data = self.file.read(self.run_rows.end)
        place = (self.path, self.run_start, len(data), "")
        self._add_block(ChunkBlock(*place, len(data), zlib.crc32(data), self.run_rows.table(), False, True))
        self.run_rows = MessageRows()

    def _add_block(self, block: ChunkBlock) -> None:
        if len(block.messages):
            self.last_log_time = int(block.messages["log_time"][-1])
            self.contents.blocks.append(block)

    # -- chunks -----------------------------------------------------------------------------------------------

    def _take_chunk(self, head: ChunkHead) -> None:
        """Take the messages of a chunk when its checksum holds; of one that the end of the file cuts, what is there."""
        self._flush_run()
        if head.compression not in CHUNK_COMPRESSIONS:
            how = f"is compressed by {head.compression!r}, which is not read (lz4 and zstd are): "
            self._lose_chunk(LossKind.UNSUPPORTED, head, how + _messages(head.count), head.count)
            return
        cut = head.payload + head.size > self.size
        self.file.seek(head.payload)
        payload = self.file.read(min(head.size, self.size - head.payload))
        longest = longest_chunk(len(payload))
        plausible = head.length <= longest
        data = self._unpack(payload, head.compression, min(head.length, longest)) if plausible or cut else b""
        crc = zlib.crc32(data)
        whole = len(data) == head.length and head.crc in (0, crc)
        if not cut and not whole:
            why = "fails its checksum" if plausible else "claims an impossible size"
            self._lose_chunk(LossKind.DAMAGED, head, f"{why}: {_messages(head.count)}", head.count)
            return
        messages, others, end = split_records(data)
        checked = whole and head.crc != 0
        place = (self.path, head.payload, len(payload), head.compression)
        self._add_block(ChunkBlock(*place, len(data), crc, messages, checked, False))
        try:
            for opcode, content in others:
                self._take_definition(opcode, content)
        except DamagedRecordError:
            self._lose_record(head.record, f"the chunk at byte {head.record} holds a damaged definition")
        if not whole:
            kept = f"is cut by the end of the file: {_messages(len(messages))} of it are kept, the others"
            self._lose_chunk(LossKind.TRUNCATED, head, kept, None)
        elif end != len(data):
            self._lose_chunk(LossKind.DAMAGED, head, "holds a damaged record: the messages behind it", None)

    def _unpack(self, payload: bytes, compression: str, length: int) -> bytes:
        """Decompress a chunk within what the whole file may unpack to."""
        data = decompress(payload, compression, min(length, self.budget.left))
        self.budget.spend(len(data))
        return data

    def _take_definition(self, opcode: int, content: bytes) -> None:
        """Remember a schema or a channel, unless the index holds it."""
        if opcode == Opcode.SCHEMA:
            schema: Schema = parse_record(Schema, content)
            self.contents.schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            channel: Channel = parse_record(Channel, content)
            self.contents.channels.setdefault(channel.id, channel)

    # -- verdicts ---------------------------------------------------------------------------------------------

    def _judge_ending(self, position: int) -> None:
        """Report a file without a sound end: cut inside of the data section, or only without its index."""
        if self.ending.data_end is not None:
            self.data_end = self.ending.data_end
        elif self.data_end is not None:
            sentence = f"the index behind byte {self.data_end} is damaged or cut off: the messages were read without it"
            self._lose(LossKind.INDEX, self.data_end, sentence, messages=0)
        elif not any(loss.kind == LossKind.TRUNCATED for loss in self.contents.losses):
            since = "" if self.last_log_time is None else f", logged from {self.last_log_time} ns on"
            sentence = f"the file ends or breaks off at byte {position}: what followed{since}, is lost"
            self._lose(LossKind.TRUNCATED, position, sentence, (self.last_log_time, None))

    def _data_section_is_sound(self) -> bool | None:
        """Whether the checksum of the data section holds; None when it was not written or is cut off."""
        if self.data_end is None:
            return None
        self.file.seek(self.data_end)
        record = self.file.read(DATA_END_SIZE)
        (expected,) = struct.unpack("<I", record[-4:])
        if record[:-4] == RECORD_HEAD.pack(Opcode.DATA_END, 4) and expected == 0:
            return None
        return record == RECORD_HEAD.pack(Opcode.DATA_END, 4) + struct.pack("<I", self._crc_until(self.data_end))

    def _crc_until(self, end: int) -> int:
        self.file.seek(0)
        crc, position = 0, 0
        while position < end and (piece := self.file.read(min(PIECE, end - position))):
            crc = zlib.crc32(piece, crc)
            position += len(piece)
        return crc

    def _judge_outside(self, sound: bool | None) -> None:
        """Take what lies outside of the chunks, unless the checksum of the data section says that it is damaged."""
        for position, opcode, content in self.others:
            try:
                if opcode == Opcode.METADATA:
                    self._take_metadata(position, parse_record(Metadata, content), sound)
                elif sound is not False:
                    self._take_definition(opcode, content)
            except DamagedRecordError:
                self._lose_record(position, f"the record at byte {position} is damaged and was skipped")
        if sound is not None:
            blocks, self.contents.blocks = self.contents.blocks, []
            for block in blocks:
                if sound:
                    self.contents.blocks.append(replace(block, checked=True))
                elif not block.outside:
                    self.contents.blocks.append(block)
                else:
                    what = "outside of the chunks cannot be trusted, as the checksum of the data section fails"
                    self._lose_messages(block, np.ones(len(block.messages), bool), what)

    def _take_metadata(self, position: int, record: Metadata, sound: bool | None) -> None:
        values = dict(record.metadata)
        own = values.pop(METADATA_CHECK, None)
        if own == metadata_checksum(record.name, values) or (own is None and sound is not False):
            self.contents.metadata[record.name] = values
        else:
            sentence = f"the metadata record {record.name!r} at byte {position} cannot be trusted and was skipped"
            self._lose(LossKind.METADATA, position, sentence, messages=0)

    def _drop_unknown_channels(self) -> None:
        known = [number for number, channel in self.contents.channels.items()]
        blocks, self.contents.blocks = self.contents.blocks, []
        for block in blocks:
            unknown = ~np.isin(block.messages["channel"], known)
            if unknown.any():
                self._lose_messages(block, unknown, "belong to topics whose names are lost")
                block = replace(block, messages=block.messages[~unknown])
            if len(block.messages):
                self.contents.blocks.append(block)

    def _compare_counts(self) -> None:
        """Hold what was found against the writer's own count, when nothing is known to be lost."""
        statistics = self.ending.statistics
        if statistics is None or any(loss.kind != LossKind.INDEX for loss in self.contents.losses):
            return
        found = sum(len(block.messages) for block in self.contents.blocks)
        if found != statistics.message_count:
            sentence = f"the writer counted {_messages(statistics.message_count)}, {found} were found"
            missing = max(0, statistics.message_count - found)
            self._lose(LossKind.DAMAGED, self.size, sentence, messages=missing)

    # -- losses -----------------------------------------------------------------------------------------------

    def _lose_chunk(self, kind: LossKind, head: ChunkHead, what: str, messages: int | None) -> None:
        sentence = f"the chunk at byte {head.record} {what}, logged from {head.start} to {head.end} ns, are lost"
        self._lose(kind, head.record, sentence, (head.start, head.end), messages)

    def _lose_messages(self, block: ChunkBlock, which: Mask, what: str) -> None:
        times = block.messages["log_time"][which]
        span = (int(times.min()), int(times.max()))
        count = int(which.sum())
        sentence = f"{_messages(count)} behind byte {block.offset}, logged from {span[0]} to {span[1]} ns, {what}"
        self._lose(LossKind.DAMAGED, block.offset, sentence, span, count)

    def _lose_stretch(self, start: int, end: int) -> None:
        """Report bytes outside of chunks: in a bag without chunks there were messages in them, else their index."""
        kind, count = (LossKind.INDEX, 0) if self.ending.chunks else (LossKind.DAMAGED, None)
        sentence = f"bytes {start} to {end}, outside of chunks, are damaged and were skipped"
        self._lose(kind, start, sentence, (self.last_log_time, None), count)

    def _lose_record(self, position: int, sentence: str) -> None:
        self._lose(LossKind.INDEX, position, sentence, messages=0)

    def _lose(
        self,
        kind: LossKind,
        offset: int,
        sentence: str,
        span: tuple[int | None, int | None] = (None, None),
        messages: int | None = None,
    ) -> None:
        self.contents.losses.append(Loss(kind, offset, *span, f"{self.path.name}: {sentence}", messages, self.path))


def _messages(count: int | None) -> str:
    """Say how many messages."""
    if count is None:
        return "an unknown number of messages"
    return "1 message" if count == 1 else f"{count} messages"
