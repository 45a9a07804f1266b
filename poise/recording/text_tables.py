"""Reading columns of text tables as programs write them: comments, rows of units, decimal commas, times of day."""

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from itertools import chain, islice
from pathlib import Path
from typing import TextIO

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.recording.blocks import Loss, LossKind
from poise.recording.contents import reason_of
from poise.recording.mapping import Clock, TextFormat
from poise.types import Array, Stamps

MAX_STAMP = 2**31 * 10**9
"""ns: a stamp's seconds are a signed 32-bit number."""
_BATCH = 4096  # rows that are converted together
_HEAD = 1000  # lines among which the header is
_DELIMITERS = ",;\t"
_NAME = re.compile("[a-df-z]", re.IGNORECASE)  # numbers have an e at most
_COMMENT = ("#", "%")
_MISSING = ("", "nan", "NaN", "NA")
_WIDE = (b"\xff\xfe", b"\xfe\xff")
_UNIT = re.compile(r"[\[(]([^\])]*)[\])]\s*$")  # "position [deg]"
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass
class RecordedTable:
    """Columns of a file.

    Args:
        columns: (N, K) by name; K is 1 but for columns whose cells hold lists.
        stamps: (N,) ns; None when no column of times was asked for.
        losses: what is wrong with the file.
        units: that the file states, by column.
    """

    columns: dict[str, Array]
    stamps: Stamps | None = None
    losses: list[Loss] = field(default_factory=list)
    units: dict[str, str] = field(default_factory=dict)


def no_column(path: Path, name: str, there: Sequence[str], hint: str = "") -> InputError:
    """The error of a name that the table lacks."""
    listed = ", ".join(there[:30]) + (", ..." if len(there) > 30 else "")
    return InputError(ErrorCode.BAD_INPUT, f"{path} has no column {name!r}: correct the mapping; it has {listed}{hint}")


def read_text(path: Path, names: Sequence[str], clock: Clock | None, options: TextFormat) -> RecordedTable:
    """Read some columns of a text table.

    Raises:
        InputError: as `read_table`.
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        encoding = "utf-16" if file.read(2) in _WIDE else "utf-8-sig"
    try:
        with path.open(newline="", encoding=encoding) as text:
            return _TextTable(path, text, names, clock, options).read()
    except (UnicodeError, csv.Error) as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path} is not a text table: {reason_of(error)}") from error


_Row = tuple[int, list[str]]
"""The number of a line, and its cells."""


class _TextTable:
    """The state of reading one text table."""

    def __init__(
        self, path: Path, file: TextIO, names: Sequence[str], clock: Clock | None, options: TextFormat
    ) -> None:
        self.path, self.file, self.names, self.clock, self.options = path, file, names, clock, options
        self.missing = options.missing | set(_MISSING)
        self.parts: dict[str, list[Array]] = {name: [] for name in names}
        self.stamps: list[int] = []
        self.losses: list[Loss] = []
        self.delimiter = options.delimiter
        self.header: list[str] = []

    def read(self) -> RecordedTable:
        named = self._read_header()
        places = {name: self._place(name) for name in self.names}
        time = None if self.clock is None else self._place(self.clock.column)
        wanted = places if self.clock is None or time is None else places | {self.clock.column: time}
        rows = self._rows()
        if named:
            next(rows, None)
        units, rows = self._units(wanted, rows)
        while batch := list(islice(rows, _BATCH)):
            for name, place in places.items():
                self.parts[name].append(self._numbers(name, [(line, row[place]) for line, row in batch]))
            if time is not None:
                self.stamps += [self._stamp(line, row[time]) for line, row in batch]
        columns = {name: self._joined(name) for name in self.names}
        stamps = None if time is None else np.array(self.stamps, dtype=np.int64)
        return RecordedTable(columns, stamps, self.losses, units)

    # -- what the first lines say --

    def _read_header(self) -> bool:
        """Find delimiter and header; whether the first row is the header.

        A header may be a comment, as `numpy.savetxt` and `rostopic echo -p` write it.
        """
        lines = [line.strip() for line in islice(self.file, _HEAD) if line.strip()]
        self.file.seek(0)
        first, second = [*(line for line in lines if not line.startswith(_COMMENT)), "", ""][:2]
        if not first:
            problem = "is empty" if not lines else "has no rows"
            raise InputError(ErrorCode.EMPTY, f"{self.path} {problem}: record again")
        self.delimiter = self.options.delimiter or _delimiter(first, second)
        row = self._split(first)
        if not self.options.header:
            self.header = [str(number + 1) for number in range(len(row))]
            return False
        comments = [self._split(line.lstrip("#% ")) for line in lines[: lines.index(first)]]
        fitting = [cells for cells in comments if len(cells) == len(row)]
        in_comment = bool(fitting) and any(self._is_value(cell) for cell in row if cell not in self.missing)
        self.header = fitting[-1] if in_comment else row
        while self.header and not self.header[-1]:
            self.header.pop()
        return not in_comment

    def _split(self, line: str) -> list[str]:
        cells = line.split() if self.delimiter == " " else next(csv.reader([line], delimiter=self.delimiter))
        return [cell.strip() for cell in cells]

    def _place(self, name: str) -> int:
        places = [at for at, there in enumerate(self.header) if there in (name, name.lstrip("#% "))]
        if len(places) > 1:
            sentence = f"{self.path} has {len(places)} columns {name!r}: rename all but one"
            raise InputError(ErrorCode.BAD_INPUT, sentence)
        if not places:
            numbers = bool(self.header) and all(self._is_value(cell) for cell in self.header)
            hint = "; if its first line holds values, set `header: false` and name the columns 1, 2, ..."
            raise no_column(self.path, name, self.header, hint if numbers else "")
        return places[0]

    def _units(self, wanted: dict[str, int], rows: Iterator[_Row]) -> tuple[dict[str, str], Iterator[_Row]]:
        """The units by column, of the header or of a row below it; and the rows after that."""
        stated = {name: _UNIT.search(self.header[place]) for name, place in wanted.items()}
        units = {name: match[1].strip() for name, match in stated.items() if match}
        first = next(rows, None)
        if first is None:
            return units, rows
        below = {name: first[1][place].strip(" []()") for name, place in wanted.items()}
        below = {name: cell for name, cell in below.items() if cell not in self.missing}
        if self.options.header and below and not any(self._is_value(cell) for cell in below.values()):
            return units | below, rows
        return units, chain([first], rows)

    # -- rows --

    def _rows(self) -> Iterator[_Row]:
        """Rows with their line numbers; a last row that the end of the file cuts is a loss."""
        rows = self._cells()
        for line, row in rows:
            cells = row
            while len(cells) > len(self.header) and not cells[-1].strip():
                cells = cells[:-1]
            if len(cells) == len(self.header):
                yield line, cells
                continue
            if len(row) < len(self.header) and next(rows, None) is None and not self._ends_with_newline():
                sentence = f"{self.path.name}: the last line ({line}) is cut and was skipped"
                size = self.path.stat().st_size
                self.losses.append(Loss(LossKind.TRUNCATED, size, None, None, sentence, 1, self.path))
                return
            sentence = f"{self.path}: line {line} has {len(row)} cells for {len(self.header)} columns: correct the line"
            raise InputError(ErrorCode.FILE_CORRUPT, sentence)

    def _cells(self) -> Iterator[_Row]:
        """The lines that are neither empty nor comments."""
        reader = csv.reader(self.file, delimiter=self.delimiter)
        spaced = ((number, line.split()) for number, line in enumerate(self.file, 1))
        for line, row in spaced if self.delimiter == " " else ((reader.line_num, row) for row in reader):
            if any(row) and not row[0].lstrip().startswith(_COMMENT):
                yield line, row

    def _ends_with_newline(self) -> bool:
        with self.path.open("rb") as file:
            file.seek(-2, 2)
            end = file.read()
        return end.endswith(b"\n") or end == "\n".encode("utf-16-le")

    # -- cells --

    def _numbers(self, name: str, cells: list[tuple[int, str]]) -> Array:
        """(N, K) numbers of one column; cells that hold lists give several."""
        try:
            return np.array([self._cell(cell) for _, cell in cells], dtype=np.float64)
        except ValueError:
            width = self.parts[name][0].shape[1] if self.parts[name] else cells[0][1].count(",") + 1
            return np.array([self._checked_cell(name, line, cell, width) for line, cell in cells], dtype=np.float64)

    def _cell(self, cell: str) -> list[float]:
        if cell[:1] in "[(":
            cell = cell.strip("[]() ")
            return [self._number(part.strip()) for part in cell.split(",")] if cell else [np.nan]
        return [self._number(cell)]

    def _number(self, cell: str) -> float:
        return np.nan if cell in self.missing else float(self._with_point(cell))

    def _with_point(self, cell: str) -> str:
        """With a decimal point: where commas do not separate the cells, they are decimal."""
        return cell if self.delimiter == "," else cell.replace(",", ".")

    def _is_value(self, cell: str) -> bool:
        try:
            self._cell(cell)
        except ValueError:
            return _moment(cell) is not None
        return True

    def _checked_cell(self, name: str, line: int, cell: str, width: int) -> list[float]:
        """As `_cell`, with the line in the error, for cells that hold `width` values."""
        try:
            values = self._cell(cell)
        except ValueError as error:
            missing = "list it under `missing` if it stands for no value, or correct the line"
            sentence = f"{self.path}: line {line}, column {name}: {cell[:40]!r} is not a number: {missing}"
            raise InputError(ErrorCode.FILE_CORRUPT, sentence) from error
        if len(values) != width:
            sentence = f"{self.path}: line {line}, column {name} holds {len(values)} values for {width}: correct it"
            raise InputError(ErrorCode.FILE_CORRUPT, sentence)
        return values

    def _stamp(self, line: int, cell: str) -> int:
        try:
            value = Decimal(self._with_point(cell.strip())) * (1 if self.clock is None else self.clock.unit)
            if abs(value) < MAX_STAMP:
                return round(value)
            problem = "is beyond the year 2038: correct time.unit"
        except (ArithmeticError, ValueError):
            moment = _moment(cell)
            if moment is not None and abs(moment) < MAX_STAMP:
                return moment
            problem = "is not a time: correct the line"
        raise InputError(ErrorCode.FILE_CORRUPT, f"{self.path}: line {line}: {cell[:40]!r} {problem}")

    def _joined(self, name: str) -> Array:
        parts = self.parts[name]
        if not parts:
            raise InputError(ErrorCode.EMPTY, f"{self.path} has no rows: record again")
        if len({part.shape[1] for part in parts}) != 1:
            sentence = f"{self.path}: the lists in column {name} have different lengths: record again"
            raise InputError(ErrorCode.FILE_CORRUPT, sentence)
        return np.concatenate(parts)


def _delimiter(first: str, second: str) -> str:
    """What separates the cells of the first two rows; a blank stands for white space."""
    found = max(_DELIMITERS, key=first.count)
    if not first.count(found):
        return " " if len(first.split()) == len(second.split()) > 1 else ","
    if found == "," and not _NAME.search(first):  # commas among numbers may be decimal
        return next((each for each in "\t;" if each in first), ",")
    return found


def _moment(cell: str) -> int | None:
    """ns since 1970 of an ISO 8601 date and time, UTC where it names no zone; None for another text."""
    try:
        moment = datetime.fromisoformat(cell.strip())
    except ValueError:
        return None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return (moment - _EPOCH) // timedelta(microseconds=1) * 1000
