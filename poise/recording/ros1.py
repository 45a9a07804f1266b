"""Reading one ROS 1 bag (format 2.0): its chunks from front to back, each message converted to CDR.

Messages of types that ROS 2 does not know, or that it lays out differently, are skipped and listed as losses: the
definitions in a bag are never compiled.

Source: wiki.ros.org/Bags/Format/2.0.
"""

import bz2
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt
from rosbags.convert.converter import is_same_wireformat
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from poise.errors import ErrorCode, InputError
from poise.recording.blocks import LossKind, decompress, longest_chunk, read_checked
from poise.recording.contents import ROS1_MAGIC, Contents, UnpackingBudget, message_table
from poise.recording.encoding import definition_of, qos_profile, typestore

_CONVERSIONS = {"none": "", "lz4": "lz4", "bz2": "bz2"}
_MESSAGE, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 5, 6, 7
_KNOWN_RECORDS = range(2, 8)
_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
_LENGTH = struct.Struct("<I")
_MAX_HEAD = 1 << 20  # bytes; a connection's head holds only its topic and number


class Record(NamedTuple):
    """A record: operation, fields of its head, and where its data lie."""

    op: int
    fields: Mapping[str, bytes]
    start: int
    size: int

    @property
    def end(self) -> int:
        """Offset behind the data."""
        return self.start + self.size


class FramingError(ValueError):
    """Bytes that are not a record."""


Connect = Callable[[Mapping[str, bytes], bytes], None]


class RawMessages(NamedTuple):
    """Messages of a chunk: connection, log time ns, and the ROS 1 bytes of each; where the last whole record ends."""

    connections: list[int]
    log_times: list[int]
    data: list[bytes]
    end: int


@dataclass(frozen=True, eq=False)
class ConvertedBlock:
    """A chunk of a ROS 1 bag, converted to CDR.

    Args:
        path: the .bag file.
        offset: of the payload in the file.
        size: bytes of the payload.
        compression: "", "lz4" or "bz2".
        length: bytes when decompressed.
        crc: CRC-32 of the decompressed bytes as they were when the file was scanned.
        types: message type by connection, of the connections that are read.
        messages: (M,) of MESSAGE.
        checked: whether the compression has a checksum (bz2).
    """

    path: Path
    offset: int
    size: int
    compression: str
    length: int
    crc: int
    types: Mapping[int, str]
    messages: npt.NDArray[np.void]
    checked: bool

    def read(self) -> bytes:
        """Return the converted messages, one after another.

        Raises:
            InputError: FILE_CORRUPT when the file has changed since the scan, FILE_UNREADABLE when it is gone.
        """
        data = read_checked(self, lambda payload: _decompress(payload, self.compression, self.length))
        raw = _split_chunk(data)
        pairs = zip(raw.connections, raw.data, strict=True)
        return b"".join(_to_cdr(message, self.types.get(connection)) for connection, message in pairs)


def scan_ros1(path: Path) -> Contents[ConvertedBlock]:
    """Find the messages of a ROS 1 bag, with its index or without.

    Raises:
        InputError: FILE_UNREADABLE; UNSUPPORTED when it unpacks beyond `longest_file`.
    """
    try:
        with path.open("rb") as file:
            return _Scan(path, file, path.stat().st_size).run()
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error


class _Scan:
    """The state of one scan."""

    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        self.path, self.file, self.size = path, file, size
        self.contents: Contents[ConvertedBlock] = Contents()
        self.types: dict[int, str] = {}
        self.channels: dict[int, int] = {}
        self.skipped: dict[int, str] = {}  # why, by connection
        self.lost: Counter[int] = Counter()  # messages skipped, by connection
        self.known: dict[tuple[str, str, str], int] = {}  # channel by topic, type and checksum of the definition
        self.budget = UnpackingBudget(path, size)
        self.last_log_time: int | None = None

    def run(self) -> Contents[ConvertedBlock]:
        position = len(ROS1_MAGIC)
        chunks = self._indexed_chunks()
        while position < self.size:
            try:
                record = _record_at(self.file, position, self.size)
            except FramingError:
                position = self._resume(position, [start for start in chunks if start > position])
                continue
            self._take(record, position)
            position = record.end
        self._report_skipped()
        return self.contents

    def _indexed_chunks(self) -> list[int]:
        """Offsets of the chunks by the index behind them; none when the bag has no index."""
        try:
            head = _record_at(self.file, len(ROS1_MAGIC), self.size)
            position = struct.unpack("<Q", head.fields["index_pos"])[0]
            found = []
            while len(ROS1_MAGIC) < position < self.size:
                record = _record_at(self.file, position, self.size)
                position = record.end
                if record.op == _CHUNK_INFO:
                    found.append(struct.unpack("<Q", record.fields["chunk_pos"])[0])
                elif record.op == _CONNECTION:
                    self._take_connection(record)
            return sorted(found)
        except (FramingError, KeyError, struct.error):
            return []

    def _resume(self, position: int, following: list[int]) -> int:
        """Report broken framing, and return where to go on: at the next chunk of the index, else at the end."""
        behind = following[0] if following else self.size
        kind = LossKind.DAMAGED if following else LossKind.TRUNCATED
        since = "" if self.last_log_time is None else f", logged after {self.last_log_time} ns"
        what = f"the messages from byte {position} to {behind}{since}, are lost: the file is cut or damaged there"
        self.contents.lose(self.path, kind, what, offset=position, since=self.last_log_time)
        return behind

    def _take(self, record: Record, position: int) -> None:
        if record.op == _CONNECTION:
            self._take_connection(record)
        elif record.op == _CHUNK:
            self._take_chunk(record, position)
        if record.end > self.size:
            self._resume(position, [])

    # -- connections ------------------------------------------------------------------------------------------

    def _take_connection(self, record: Record) -> None:
        self.file.seek(record.start)
        self._connect(record.fields, self.file.read(min(record.size, self.size)))

    def _connect(self, head: Mapping[str, bytes], data: bytes) -> None:
        """Remember a connection: its topic and type."""
        try:
            number = _LENGTH.unpack(head["conn"])[0]
            fields = _fields(data)
            topic, kind = head["topic"].decode(), fields["type"].decode()
            checksum = fields.get("md5sum", b"*").decode()
        except (KeyError, struct.error, UnicodeDecodeError, FramingError):
            return
        if number in self.types or number in self.skipped:
            return
        package, _, name = kind.partition("/")
        message_type = f"{package}/msg/{name}"
        message_type = _RENAMED.get(message_type, message_type)
        reason = _difference(message_type, checksum)
        if reason:
            self.skipped[number] = f"{topic} ({kind}): {reason}"
            return
        if (topic, message_type, checksum) not in self.known:
            definition, type_hash = definition_of(message_type)
            metadata = {"offered_qos_profiles": qos_profile(topic), "topic_type_hash": type_hash}
            channel = self.contents.add_topic(
                self.path, topic, message_type, definition=(definition, "ros2msg"), metadata=metadata
            )
            self.known[topic, message_type, checksum] = channel
        self.channels[number] = self.known[topic, message_type, checksum]
        self.types[number] = message_type

    def _report_skipped(self) -> None:
        for number, count in self.lost.items():
            why = self.skipped.get(number, f"connection {number}, which the bag does not describe")
            noun = "message was" if count == 1 else "messages were"
            self.contents.lose(self.path, LossKind.UNSUPPORTED, f"{count} {noun} skipped of {why}", messages=count)

    # -- chunks -----------------------------------------------------------------------------------------------

    def _take_chunk(self, record: Record, position: int) -> None:
        """Take the messages of a chunk that decompresses to the length it claims; of one that is cut, what is there."""
        compression = _CONVERSIONS.get(record.fields.get("compression", b"").decode(errors="replace"))
        if compression is None or "size" not in record.fields:
            self._lose_chunk(position, LossKind.UNSUPPORTED, "has a compression that is not read (none, bz2, lz4 are)")
            return
        cut = record.end > self.size
        self.file.seek(record.start)
        payload = self.file.read(min(record.size, self.size - record.start))
        (length,) = _LENGTH.unpack(record.fields["size"])
        longest = longest_chunk(len(payload))
        plausible = length <= longest
        data = _decompress(payload, compression, min(length, longest, self.budget.left)) if plausible or cut else b""
        self.budget.spend(len(data))
        if not cut and len(data) != length:
            why = "does not decompress" if plausible else "claims an impossible size"
            self._lose_chunk(position, LossKind.DAMAGED, why)
            return
        raw = _split_chunk(data, self._connect)
        if raw.end != len(data) and not cut:
            self._lose_chunk(position, LossKind.DAMAGED, "holds a damaged record: the messages behind it are skipped")
        place = (self.path, record.start, len(payload), compression, len(data), zlib.crc32(data))
        self._add_block(place, raw, checked=compression == "bz2" and not cut)

    def _add_block(self, place: tuple[Path, int, int, str, int, int], raw: RawMessages, *, checked: bool) -> None:
        sizes = []
        for connection, message in zip(raw.connections, raw.data, strict=True):
            kind = self.types.get(connection)
            sizes.append(len(_to_cdr(message, kind)))
            if not sizes[-1]:
                self.lost[connection] += 1
                if kind is not None:
                    self.skipped.setdefault(connection, f"connection {connection}: they are not of type {kind}")
        kept = np.array(sizes, dtype=np.int64) > 0
        if not kept.any():
            return
        channels = np.array([self.channels.get(number, 0) for number in raw.connections])[kept]
        log_times = np.array(raw.log_times, dtype=np.uint64)[kept]
        table = message_table(channels, log_times, np.array(sizes, dtype=np.int64)[kept])
        self.last_log_time = int(log_times[-1])
        self.contents.blocks.append(ConvertedBlock(*place, dict(self.types), table, checked))

    def _lose_chunk(self, position: int, kind: LossKind, why: str) -> None:
        sentence = f"the chunk at byte {position} {why}"
        self.contents.lose(self.path, kind, sentence, offset=position, since=self.last_log_time)


def _record_at(file: BinaryIO, position: int, size: int) -> Record:
    """Read the head of a record; its data may end behind the file.

    Raises:
        FramingError: there is no record of format 2.0 at this place.
    """
    file.seek(position)
    head_size = _length(file.read(_LENGTH.size))
    if head_size > min(size - position, _MAX_HEAD):
        raise FramingError
    fields = _fields(file.read(head_size))
    data_size = _length(file.read(_LENGTH.size))
    return Record(_operation(fields), fields, position + 2 * _LENGTH.size + head_size, data_size)


def _length(data: bytes) -> int:
    if len(data) < _LENGTH.size:
        raise FramingError
    return int(_LENGTH.unpack(data)[0])


def _operation(fields: Mapping[str, bytes]) -> int:
    op = fields.get("op", b"")
    if len(op) != 1 or op[0] not in _KNOWN_RECORDS:
        raise FramingError
    return op[0]


def _fields(data: bytes) -> dict[str, bytes]:
    """Split a head into its fields, each a length and name=value."""
    fields: dict[str, bytes] = {}
    position = 0
    while position < len(data):
        length = _length(data[position : position + _LENGTH.size])
        name, separator, value = data[position + _LENGTH.size : position + _LENGTH.size + length].partition(b"=")
        position += _LENGTH.size + length
        if not separator or position > len(data):
            raise FramingError
        fields[name.decode(errors="replace")] = value
    return fields


def _split_chunk(data: bytes, connect: Connect | None = None) -> RawMessages:
    """Split a chunk into its messages, and hand its connections to `connect`."""
    raw = RawMessages([], [], [], 0)
    end = 0
    try:
        for record, content, end in _records(data):  # noqa: B007
            if record.op == _CONNECTION and connect is not None:
                connect(record.fields, content)
            elif record.op == _MESSAGE:
                seconds, nanoseconds = struct.unpack("<II", record.fields["time"])
                raw.connections.append(_LENGTH.unpack(record.fields["conn"])[0])
                raw.log_times.append(seconds * 10**9 + nanoseconds)
                raw.data.append(content)
    except (FramingError, KeyError, struct.error):
        pass
    return raw._replace(end=end)


def _records(data: bytes) -> Iterator[tuple[Record, bytes, int]]:
    """Whole records of a chunk, their data, and where they end."""
    position = 0
    while position < len(data):
        head_size = _length(data[position : position + _LENGTH.size])
        start = position + _LENGTH.size + head_size
        fields = _fields(data[position + _LENGTH.size : start])
        size = _length(data[start : start + _LENGTH.size])
        record = Record(_operation(fields), fields, start + _LENGTH.size, size)
        if record.end > len(data):
            raise FramingError
        yield record, data[record.start : record.end], record.end
        position = record.end


def _decompress(payload: bytes, compression: str, length: int) -> bytes:
    """Decompress as far as possible, and never beyond `length` (one byte more shows that there is more)."""
    if compression != "bz2":
        return decompress(payload, compression, length)
    try:
        return bz2.BZ2Decompressor().decompress(payload, max_length=length + 1)
    except (OSError, EOFError):
        return b""


def _to_cdr(message: bytes, message_type: str | None) -> bytes:
    """Convert a message; nothing when it is not of its type."""
    if message_type is None:
        return b""
    try:
        return bytes(typestore().ros1_to_cdr(message, message_type))
    except (SerdeError, AssertionError, ValueError, IndexError, struct.error, UnicodeDecodeError, MemoryError):
        return b""


@cache
def _difference(message_type: str, checksum: str) -> str:
    """Why messages of this ROS 1 type cannot be converted; empty when ROS 2 lays them out alike."""
    noetic, jazzy = _noetic(), typestore()
    if message_type not in noetic.fielddefs or message_type not in jazzy.fielddefs:
        return "the type is not one of the common types of ROS 1 and ROS 2"
    if checksum not in ("*", noetic.gendefhash(message_type, {}, 1)[1]):
        return "the bag's definition of the type is not that of ROS Noetic"
    if not is_same_wireformat(noetic, jazzy, message_type, message_type):
        return "ROS 1 and ROS 2 define the type differently"
    return ""


@cache
def _noetic() -> Typestore:
    """The message types of ROS Noetic, with that of tf, which rosbags leaves out."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    return store
