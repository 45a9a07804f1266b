"""Opening one file of a recording: its first bytes say which reader it needs, its name only decides for text."""

from pathlib import Path
from typing import Any

from poise.errors import ErrorCode, InputError
from poise.recording import compressed, scan, sqlite
from poise.recording.contents import ROS1_MAGIC, Contents
from poise.recording.table_recording import read_tables

_TABLE_ENDINGS = (".csv", ".tsv", ".txt", ".mat", ".npz")
_MAPPING_ENDINGS = (".yaml", ".yml")


def read_contents(path: Path) -> Contents[Any]:
    """Find every message of a file: mcap, db3, either of them compressed by zstd, ROS 1 bag, or tables with a mapping.

    Raises:
        InputError: FILE_UNREADABLE, EMPTY (no byte in it), FILE_CORRUPT, UNSUPPORTED, BAD_INPUT (mapping).
    """
    if path.suffix.lower() in _MAPPING_ENDINGS:
        return read_tables(path)
    if path.suffix.lower() in _TABLE_ENDINGS:
        return read_tables(mapping_of(path))
    magic = _first_bytes(path)
    if magic.startswith(compressed.ZSTD_MAGIC):
        folder, unpacked, losses = compressed.unpack_file(path)
        try:
            contents = read_contents(unpacked)
        except InputError as error:
            sentence = error.message.replace(str(unpacked), str(path))
            raise InputError(error.code, sentence, **error.data) from error
        contents.unpacked = folder
        contents.losses[:0] = losses
        return contents
    reader = next((read for start, read in _READERS if magic.startswith(start)), scan.scan)
    return compressed.unpack_messages(path, reader(path))


def _scan_ros1(path: Path) -> Contents[Any]:
    from poise.recording import ros1  # the converters it needs load slowly

    return ros1.scan_ros1(path)


_READERS = ((sqlite.SQLITE_MAGIC, sqlite.scan_sqlite), (ROS1_MAGIC, _scan_ros1))


def mapping_of(table: Path) -> Path:
    """The mapping file beside a table: NAME.columns.yaml, else columns.yaml.

    Raises:
        InputError: FILE_UNREADABLE when there is none.
    """
    own, shared = table.with_name(f"{table.stem}.columns.yaml"), table.with_name("columns.yaml")
    for mapping in (own, shared):
        if mapping.exists():
            return mapping
    sentence = f"{table} has no mapping beside it: write {shared.name}, as docs/recording.md shows, to name its columns"
    raise InputError(ErrorCode.FILE_UNREADABLE, sentence)


def _first_bytes(path: Path) -> bytes:
    try:
        if not path.is_file():  # opening a pipe would wait for a writer
            return b""
        with path.open("rb") as file:
            return file.read(16)
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error
