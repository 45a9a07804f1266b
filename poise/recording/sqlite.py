"""Reading one .db3 file, the SQLite storage of rosbag2: its topics, and every message that can still be read."""

import sqlite3
import struct
import zlib
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from poise.errors import ErrorCode, InputError
from poise.recording.blocks import PIECE, LossKind
from poise.recording.contents import Contents, TemporaryFolder, message_table, reason_of
from poise.recording.encoding import definition_of
from poise.types import Indices

SQLITE_MAGIC = b"SQLite format 3\0"
_HEAD_SIZE = 100  # bytes; the page size follows the magic (SQLite file format, section 1.3)
_JOURNAL = "-wal"
_BLOCK_SIZE = 4 << 20  # bytes of messages that are read together
_TABLES = ("messages", "topics")
_MAX_ID = 2**63 - 1
_ROWS = "SELECT id, topic_id, timestamp, data FROM messages WHERE id BETWEEN ? AND ? ORDER BY id"
Row = tuple[int, Any, Any, Any]


@dataclass(frozen=True, eq=False)
class RowBlock:
    """A run of rows of the table `messages`.

    Args:
        path: the .db3 file.
        ids: (M,) the rows.
        crc: CRC-32 of the messages as they were when the file was scanned.
        messages: (M,) of MESSAGE.
        checked: never, as SQLite keeps no checksums.
    """

    path: Path
    ids: Indices
    crc: int
    messages: npt.NDArray[np.void]
    checked: bool = False

    def read(self) -> bytes:
        """Return the messages, one after another.

        Raises:
            InputError: FILE_CORRUPT when the file has changed since the scan, FILE_UNREADABLE when it is gone.
        """
        wanted = set(self.ids.tolist())
        try:
            with closing(_connect(self.path)) as database:
                rows = database.execute(_ROWS, (int(self.ids[0]), int(self.ids[-1])))
                data = b"".join(row[3] for row in rows if row[0] in wanted and isinstance(row[3], bytes))
        except sqlite3.Error as error:
            raise InputError(ErrorCode.FILE_UNREADABLE, f"{self.path} cannot be read: {reason_of(error)}") from error
        if zlib.crc32(data) != self.crc:
            raise InputError(
                ErrorCode.FILE_CORRUPT, f"{self.path} changed while it was being read: let its writer finish, reopen it"
            )
        return data


def scan_sqlite(path: Path) -> Contents[RowBlock]:
    """Find the messages of a .db3 file; rows that cannot be read are skipped and reported.

    Raises:
        InputError: FILE_UNREADABLE; FILE_CORRUPT when it is not a bag of rosbag2 or its list of topics is damaged.
    """
    try:
        folder = _copy_of_whole_pages(path)
        file = path if folder is None else folder.path / path.name
        with closing(_connect(file)) as database:
            contents = _Scan(path, file, database).run()
    except sqlite3.Error as error:
        sentence = f"{path} is damaged: its tables cannot be read ({reason_of(error)}); copy it again from its source"
        raise InputError(ErrorCode.FILE_CORRUPT, sentence) from error
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error
    if folder is not None:
        contents.unpacked = folder
        if not contents.losses:
            contents.lose(path, LossKind.TRUNCATED, "the end of the file is cut in the middle of a page")
    return contents


def _copy_of_whole_pages(path: Path) -> TemporaryFolder | None:
    """Copy a file that is cut in the middle of a page without that page, which SQLite would fill up with zeros.

    Returns:
        The temporary folder of the copy; None for a file of whole pages.
    """
    with path.open("rb") as file:
        (page_size,) = struct.unpack_from(">H", file.read(_HEAD_SIZE).ljust(_HEAD_SIZE, bytes(1)), len(SQLITE_MAGIC))
        page_size = page_size if page_size > 1 else 1 << 16
        size = path.stat().st_size
        if size % page_size == 0:
            return None
        folder = TemporaryFolder()
        file.seek(0)
        with (folder.path / path.name).open("wb") as copy:
            left = size - size % page_size
            while left and (piece := file.read(min(PIECE, left))):
                copy.write(piece)
                left -= len(piece)
    return folder


def _connect(path: Path) -> sqlite3.Connection:
    """Open read-only; a journal beside the file (-wal) is read too, as a recorder that was killed leaves it."""
    if not path.is_file():
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} is not a file: give a .db3 file or a bag's folder")
    journal = path.with_name(path.name + _JOURNAL)
    mode = "mode=ro" if journal.exists() and journal.stat().st_size else "immutable=1"
    database = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True)
    database.text_factory = _text
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(path.stat().st_size, 1 << 20))  # of a value
    database.execute("PRAGMA trusted_schema=OFF")
    database.execute("PRAGMA writable_schema=ON")  # else SQLite refuses a file that is cut
    return database


def _text(data: bytes) -> str:
    return data.decode(errors="replace")


class _Scan:
    """The state of one scan."""

    def __init__(self, path: Path, file: Path, database: sqlite3.Connection) -> None:
        self.path, self.file, self.database = path, file, database
        journal = path.with_name(path.name + _JOURNAL)
        self.size = path.stat().st_size + (journal.stat().st_size if journal.exists() else 0)
        self.contents: Contents[RowBlock] = Contents()
        self.channel_by_topic: dict[int, int] = {}
        self.rows: list[tuple[int, int, int, bytes]] = []  # of the next block: id, channel, log time, message
        self.pending = 0  # bytes of them
        self.total = 0  # bytes of all messages
        self.foreign = 0  # rows that make no sense

    def run(self) -> Contents[RowBlock]:
        self._check_tables()
        self._read_topics()
        for row in self._readable_rows():
            self._take(row)
        self._flush()
        if self.foreign:
            sentence = f"{self.foreign} rows are of no topic or hold no message, and were skipped"
            self.contents.lose(self.path, LossKind.DAMAGED, sentence, messages=self.foreign)
        return self.contents

    def _check_tables(self) -> None:
        """Accept tables alone: a view could give rows without end."""
        kinds: dict[str, tuple[str, str]] = {
            name: (kind, sql or "")
            for kind, name, sql in self.database.execute("SELECT type, name, sql FROM sqlite_master")
            if kind in ("table", "view")
        }
        for name in _TABLES:
            kind, sql = kinds.get(name, ("", ""))
            if kind != "table" or not sql.upper().startswith("CREATE TABLE") or "GENERATED" in sql.upper():
                sentence = f"{self.path} is an SQLite file without rosbag2's table {name!r}: give a bag of `ros2 bag`"
                raise InputError(ErrorCode.FILE_CORRUPT, sentence)

    def _read_topics(self) -> None:
        columns = {row[1] for row in self.database.execute("PRAGMA table_info(topics)")}
        lacking = {"id", "name", "type", "serialization_format"} - columns
        if lacking:
            sentence = f"{self.path}: the table of topics lacks {', '.join(sorted(lacking))}: record it with `ros2 bag`"
            raise InputError(ErrorCode.FILE_CORRUPT, sentence)
        optional = [name for name in ("offered_qos_profiles", "type_description_hash") if name in columns]
        query = f"SELECT {', '.join(['id', 'name', 'type', 'serialization_format', *optional])} FROM topics"
        definitions = self._definitions()
        for number, name, kind, encoding, *more in self.database.execute(query):
            metadata = dict(zip(optional, map(str, more), strict=True))
            if "type_description_hash" in metadata:
                metadata["topic_type_hash"] = metadata.pop("type_description_hash")
            self.channel_by_topic[number] = self.contents.add_topic(
                self.path,
                str(name),
                str(kind),
                encoding=str(encoding),
                definition=definitions.get(kind) or _known_definition(str(kind)),
                metadata=metadata,
            )

    def _definitions(self) -> dict[str, tuple[str, str]]:
        """Message definitions by type; bags of rosbag2 before Iron have none."""
        query = "SELECT topic_type, encoded_message_definition, encoding FROM message_definitions"
        try:
            return {str(kind): (str(text), str(language)) for kind, text, language in self.database.execute(query)}
        except sqlite3.Error:
            return {}

    # -- rows -------------------------------------------------------------------------------------------------

    def _readable_rows(self) -> Iterator[Row]:
        """Give the rows by their id, and step over stretches whose pages are damaged or cut off."""
        after = -1
        while True:
            try:
                for row in self.database.execute(_ROWS, (after + 1, _MAX_ID)):
                    after = row[0]
                    yield row
                return
            except sqlite3.Error:
                following = self._next_readable(after + 1)
                self._lose_rows(after + 1, following)
                if following is None:
                    return
                after = following - 1

    def _next_readable(self, damaged: int) -> int | None:
        """Find the least row number behind a damaged row from which rows can be read, by doubling and bisection."""
        low, high = damaged, damaged + 1
        while not self._reads_from(high):
            low, high = high, 2 * high - damaged
            if high - damaged > self.size:  # a row has more than one byte
                return None
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self._reads_from(middle) else (middle, high)
        row = self.database.execute(_ROWS, (high, _MAX_ID)).fetchone()
        return None if row is None else int(row[0])

    def _reads_from(self, number: int) -> bool:
        try:
            self.database.execute(_ROWS, (number, _MAX_ID)).fetchone()
        except sqlite3.Error:
            return False
        return True

    def _lose_rows(self, first: int, following: int | None) -> None:
        self._flush()
        blocks = self.contents.blocks
        since = int(blocks[-1].messages["log_time"][-1]) if blocks else None
        where = f"from row {first} on" if following is None else f"from row {first} to {following - 1}"
        kind = LossKind.TRUNCATED if following is None else LossKind.DAMAGED
        logged = "" if since is None else f", logged after {since} ns"
        count = None if following is None else following - first
        sentence = f"the messages {where}{logged}, cannot be read: the file is cut or damaged there"
        self.contents.lose(self.path, kind, sentence, since=since, messages=count)

    def _take(self, row: Row) -> None:
        number, topic, log_time, data = row
        channel = self.channel_by_topic.get(topic) if isinstance(topic, int) else None
        if channel is None or not isinstance(data, bytes) or not isinstance(log_time, int) or log_time < 0:
            self.foreign += 1
            return
        self.rows.append((number, channel, log_time, data))
        self.pending += len(data)
        self.total += len(data)
        if self.total > self.size:
            sentence = f"{self.path} is damaged: its rows hold more bytes than the file; copy it again from its source"
            raise InputError(ErrorCode.FILE_CORRUPT, sentence)
        if self.pending > _BLOCK_SIZE:
            self._flush()

    def _flush(self) -> None:
        if not self.rows:
            return
        ids, channels, log_times, messages = zip(*self.rows, strict=True)
        sizes = np.array([len(message) for message in messages])
        table = message_table(channels, log_times, sizes)
        block = RowBlock(self.file, np.array(ids), zlib.crc32(b"".join(messages)), table)
        self.contents.blocks.append(block)
        self.rows, self.pending = [], 0


def _known_definition(kind: str) -> tuple[str, str]:
    """The definition of a common type; empty for others, which are given as bytes."""
    try:
        return definition_of(kind)[0], "ros2msg"
    except InputError:
        return "", ""
