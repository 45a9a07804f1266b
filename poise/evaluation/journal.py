"""The journal of an evaluation: one line of JSON for each answer, kept as soon as it is there; a later run goes on."""

import fcntl
import json
import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from poise.errors import ErrorCode, InputError
from poise.evaluation.sources import DataSource

JOURNAL = "journal.jsonl"


class Journal:
    """The file `journal.jsonl` of a folder of results, open for appending; one process at a time.

    The first line is the heading (job, arguments, build); each other line is the reply about one source. A line that a
    kill or a full disk cut off is removed when the file is opened again.

    Args:
        folder: of the results; made when missing.
        heading: what all replies have in common.

    Raises:
        InputError: BUSY when another process has it open, BAD_INPUT when it was begun with another heading,
            FILE_UNWRITABLE.
    """

    def __init__(self, folder: Path, heading: dict[str, Any]) -> None:
        self.path = folder / JOURNAL
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("ab", buffering=0)  # nothing waits in a buffer when the disk is full
        except OSError as error:
            raise self._unwritable(error) from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._file.close()
            message = f"{folder}: another evaluation writes its results there; wait, or give another --results"
            raise InputError(ErrorCode.BUSY, message) from error
        try:
            self._size = self._whole_lines()
            os.ftruncate(self._file.fileno(), self._size)
            if not self._size:
                self._write({"heading": heading})
            self._compare(heading)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def append(self, source: DataSource, reply: dict[str, Any]) -> None:
        """Keep the reply about a source.

        Raises:
            InputError: FILE_UNWRITABLE, for example on a full disk; everything before is kept.
        """
        self._write({"name": source.name, "size": source.size, "modified": source.modified, **reply})

    def entries(self) -> Iterator[dict[str, Any]]:
        """All replies, with the name, size and time of their sources, in the order in which they were written."""
        with self.path.open("rb") as file:
            next(file, None)
            for line in file:
                yield json.loads(line)

    def _write(self, content: dict[str, Any]) -> None:
        line = json.dumps(content, ensure_ascii=False).encode() + b"\n"
        written = 0
        try:
            while written < len(line):
                written += self._file.write(line[written:])
        except OSError as error:
            os.ftruncate(self._file.fileno(), self._size)
            raise self._unwritable(error) from error
        self._size += len(line)

    def _whole_lines(self) -> int:
        """Bytes up to the end of the last whole line."""
        with self.path.open("rb") as file:
            return sum(len(line) for line in file if line.endswith(b"\n"))

    def _compare(self, heading: dict[str, Any]) -> None:
        try:
            with self.path.open("rb") as file:
                begun = json.loads(file.readline())["heading"]
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(ErrorCode.FILE_CORRUPT, f"{self.path} is not a journal of poise evaluate") from error
        for name, value in heading.items():
            if begun.get(name) != value:
                raise InputError(
                    ErrorCode.BAD_INPUT,
                    f"{self.path.parent} holds results of {name} {_words(begun.get(name))}, not {_words(value)}: "
                    "give another --results, or delete the folder",
                )

    def _unwritable(self, error: OSError) -> InputError:
        message = f"cannot write {self.path}: {error.strerror}; what was done is kept: free space and run it again"
        return InputError(ErrorCode.FILE_UNWRITABLE, message, path=str(self.path))


def _words(value: Any) -> str:
    return " ".join(map(str, value)) or "none" if isinstance(value, list) else str(value)
