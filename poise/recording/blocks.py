"""Blocks: the stretches of an mcap file that are checked and decompressed as one, and the messages in them."""

import struct
import zlib
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from io import BytesIO
from pathlib import Path
from typing import Any, Protocol

import lz4.frame
import numpy as np
import numpy.typing as npt
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from poise.errors import ErrorCode, InputError
from poise.kernels import COMPILED, find_records

MCAP_MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")  # opcode, length of what follows
MESSAGE_HEAD = struct.Struct("<BQHIQQ")  # record head, channel, sequence, log time, publish time
# Where the messages of a block are: `start` counts from the first byte of the decompressed block.
MESSAGE = np.dtype([("channel", "u2"), ("log_time", "u8"), ("start", "i8"), ("size", "i8")])

# Bounds of decompression. Measured bags unpack to 2 to 9 times their size; one uncompressed 4K image has 25 MB.
_ALWAYS_ALLOWED = 64 << 20
"""Bytes that a chunk, and all chunks of a file together, may unpack to, however small they are in the file."""
_MAX_CHUNK_RATIO = 32
"""Above _ALWAYS_ALLOWED: bytes that a chunk may unpack to for each byte in the file."""
_MAX_FILE_RATIO = 128
"""Above _ALWAYS_ALLOWED: bytes that all chunks of a file may unpack to for each byte of the file."""
PIECE = 1 << 20

CHUNK_COMPRESSIONS = ("", "lz4", "zstd")

MessageRow = tuple[int, int, int, int]


class LossKind(StrEnum):
    """What happened to the part of a bag that was lost."""

    TRUNCATED = "truncated"  # the file ends early
    DAMAGED = "damaged"  # messages were skipped because they cannot be trusted
    METADATA = "metadata"  # a metadata record was skipped because it cannot be trusted
    UNSUPPORTED = "unsupported"  # messages are in a chunk whose compression is not read
    INDEX = "index"  # bytes are damaged that carry no message: nothing of the content is lost


@dataclass(frozen=True)
class Loss:
    """One thing that is wrong with a bag, and what it cost.

    Args:
        kind: what happened.
        offset: where in the file, bytes.
        start_stamp: log time from which messages may be lost, ns; None when unknown.
        end_stamp: log time until which messages may be lost, ns; None when unknown.
        sentence: the same for people.
        messages: how many were lost; None when unknown.
        file: the .mcap file.
    """

    kind: LossKind
    offset: int
    start_stamp: int | None
    end_stamp: int | None
    sentence: str
    messages: int | None
    file: Path


@dataclass(frozen=True, eq=False)
class ChunkBlock:
    """A chunk, or a run of messages outside of chunks.

    Args:
        path: the .mcap file.
        offset: of the first byte in the file.
        size: bytes in the file.
        compression: "", "lz4" or "zstd".
        crc: CRC-32 of the decompressed bytes as they were when the file was scanned.
        messages: (M,) of MESSAGE.
        checked: whether the writer left a checksum that vouches for these bytes.
        outside: whether this is a run outside of chunks.
    """

    path: Path
    offset: int
    size: int
    compression: str
    length: int
    crc: int
    messages: npt.NDArray[np.void]
    checked: bool
    outside: bool

    def read(self) -> bytes:
        """Return the decompressed bytes, the same as when the file was scanned.

        Raises:
            InputError: FILE_CORRUPT when the file has changed since, FILE_UNREADABLE when it is gone.
        """
        return read_checked(self, lambda payload: decompress(payload, self.compression, self.length))


def longest_chunk(size: int) -> int:
    """Bytes that a chunk of `size` bytes in the file may unpack to."""
    return max(_ALWAYS_ALLOWED, _MAX_CHUNK_RATIO * size)


def longest_file(size: int) -> int:
    """Bytes that the chunks of a file of `size` bytes may unpack to together."""
    return max(_ALWAYS_ALLOWED, _MAX_FILE_RATIO * size)


def decompress(payload: bytes, compression: str, length: int) -> bytes:
    """Decompress as far as possible, and never beyond `length` (one byte more shows that there is more).

    A payload that is cut gives what its last whole block holds, a damaged one little or nothing: compare the checksum.
    """
    if compression == "":
        return payload
    try:
        if compression == "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(payload, max_length=length + 1))
        if compression == "zstd":
            return _decompress_zstd(payload, length + 1)
    except (zstandard.ZstdError, RuntimeError, EOFError):
        pass
    return b""


def _decompress_zstd(payload: bytes, limit: int) -> bytes:
    """Decompress in pieces: the claimed length is never allocated before that much has come."""
    source = zstandard.ZstdDecompressor().stream_reader(payload)
    pieces: list[bytes] = []
    while limit > 0 and (piece := source.read(min(PIECE, limit))):
        pieces.append(piece)
        limit -= len(piece)
    return b"".join(pieces)  # a single piece is not copied


class MessageRows:
    """Where messages are: (channel, log time, start, size) of each, in 32 bytes a message."""

    def __init__(self) -> None:
        self._numbers = array("Q")

    def __len__(self) -> int:
        return len(self._numbers) // 4

    def append(self, row: MessageRow) -> None:
        """Add one message."""
        self._numbers.extend(row)

    @property
    def end(self) -> int:
        """Offset behind the last message; 0 when there is none."""
        return self._numbers[-2] + self._numbers[-1] if self._numbers else 0

    def table(self) -> npt.NDArray[np.void]:
        """(M,) of MESSAGE."""
        return _message_table(np.frombuffer(self._numbers, dtype=np.uint64).reshape(-1, 4))


def _message_table(rows: npt.NDArray[np.uint64]) -> npt.NDArray[np.void]:
    """(M,) of MESSAGE, of rows (M, 4)."""
    table = np.empty(len(rows), dtype=MESSAGE)
    for name, column in zip(MESSAGE.names or (), rows.T, strict=True):
        table[name] = column
    return table


def split_records(data: bytes) -> tuple[npt.NDArray[np.void], list[tuple[int, bytes]], int]:
    """Split the content of a chunk into its records.

    Returns:
        Messages (M,) of MESSAGE, schemas and channels as (opcode, content), the first of each number, and the offset
        behind the last whole record.
    """
    definitions: dict[tuple[int, bytes], bytes] = {}
    if COMPILED:
        messages, records, position = find_records(data)
        for opcode, start, behind in records.tolist():
            definitions.setdefault((opcode, data[start : start + 2]), data[start:behind])
        contents = [(opcode, content) for (opcode, _), content in definitions.items()]
        return _message_table(messages), contents, position
    rows = MessageRows()
    position, end = 0, len(data)
    head, message_head, message = RECORD_HEAD.size, MESSAGE_HEAD.size, int(Opcode.MESSAGE)  # read once a record
    read_head, read_message, append = RECORD_HEAD.unpack_from, MESSAGE_HEAD.unpack_from, rows.append
    while position + head <= end:
        opcode, length = read_head(data, position)
        behind = position + head + length
        start = position + message_head
        if behind > end or opcode == 0 or (opcode == message and start > behind):
            break
        if opcode == message:
            _, _, channel, _, log_time, _ = read_message(data, position)
            append((channel, log_time, start, behind - start))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            start = position + RECORD_HEAD.size
            definitions.setdefault((opcode, data[start : start + 2]), data[start:behind])  # they begin with the number
        position = behind
    return rows.table(), [(opcode, content) for (opcode, _), content in definitions.items()], position


class DamagedRecordError(ValueError):
    """A record whose content does not fit its length."""


class _ExactBytes(BytesIO):
    """Bytes that never give less than asked for."""

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size)
        if size is not None and len(data) < size:
            raise DamagedRecordError(f"a field of {size} bytes where {len(data)} are left")
        return data


def parse_record(record_type: Any, content: bytes) -> Any:
    """Parse a record's content with a record class of the mcap library, every length held against what is there.

    Raises:
        DamagedRecordError: a length or a text in it is impossible.
    """
    try:
        return record_type.read(ReadDataStream(_ExactBytes(content)))
    except (struct.error, UnicodeDecodeError) as error:
        raise DamagedRecordError(str(error)) from error


class StoredBytes(Protocol):
    """Where compressed bytes are in a file, and the checksum of what they unpack to."""

    @property
    def path(self) -> Path: ...
    @property
    def offset(self) -> int: ...
    @property
    def size(self) -> int: ...
    @property
    def crc(self) -> int: ...


def read_checked(stored: StoredBytes, unpack: Callable[[bytes], bytes]) -> bytes:
    """Read and unpack bytes of a file that was scanned before.

    Raises:
        InputError: FILE_CORRUPT when the file has changed since the scan, FILE_UNREADABLE when it is gone.
    """
    try:
        with stored.path.open("rb") as file:
            file.seek(stored.offset)
            data = unpack(file.read(stored.size))
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{stored.path} cannot be read: {error.strerror}") from error
    if zlib.crc32(data) != stored.crc:
        raise InputError(
            ErrorCode.FILE_CORRUPT, f"{stored.path} changed while it was being read: let its writer finish, reopen it"
        )
    return data
