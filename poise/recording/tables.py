"""Reading columns of numbers from text tables (CSV), MATLAB files and NumPy archives."""

import csv
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import numpy as np
import numpy.typing as npt

from poise.errors import ErrorCode, InputError
from poise.recording.blocks import PIECE, Loss, LossKind
from poise.recording.contents import UnpackingBudget, reason_of
from poise.recording.mapping import Clock, TextFormat
from poise.types import Array, Stamps

_BATCH = 4096  # rows that are converted together
_DELIMITERS = ",;\t"
_MISSING = ("", "nan", "NaN", "NA")
_MAX_STAMP = 2**31 * 10**9  # ns: a stamp's seconds are a signed 32-bit number
_NUMBER_CLASSES = ("double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
MAT_HEAD, MAT_COMPRESSED, HDF5 = 128, 15, b"\x89HDF"


@dataclass
class RecordedTable:
    """Columns of a file.

    Args:
        columns: (N, K) by name; K is 1 but for columns whose cells hold lists.
        stamps: (N,) ns; None when no column of times was asked for.
        losses: what is wrong with the file.
    """

    columns: dict[str, Array]
    stamps: Stamps | None = None
    losses: list[Loss] = field(default_factory=list)


def read_table(path: Path, names: Sequence[str], clock: Clock | None, text: TextFormat) -> RecordedTable:
    """Read some columns of a table; the ending of its name says which kind it is.

    Args:
        path: .mat, .npz, or text.
        names: of the columns or arrays.
        clock: the column of times; None, or one without a column, to read none.
        text: the format of a text table.

    Raises:
        InputError: FILE_UNREADABLE; BAD_INPUT (a column that is not there); FILE_CORRUPT (line, and what is wrong);
            UNSUPPORTED (unpacks too far, or a kind of array that is not read); EMPTY.
    """
    wanted = list(dict.fromkeys(names))
    time = clock if clock is not None and clock.column else None
    try:
        if path.suffix.lower() in (".mat", ".npz"):
            return _read_arrays(path, wanted, time)
        with path.open(newline="", encoding="utf-8-sig") as file:
            return _TextTable(path, file, wanted, time, text).read()
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path} is not a text table: {reason_of(error)}") from error


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
        self.header: list[str] = []

    def read(self) -> RecordedTable:
        first = self.file.readline()
        if not first.strip():
            raise InputError(ErrorCode.EMPTY, f"{self.path} is empty: record again")
        delimiter = self.options.delimiter or max(_DELIMITERS, key=first.count)
        self.file.seek(0)
        reader = csv.reader(self.file, delimiter=delimiter)
        first_row = next(csv.reader([first], delimiter=delimiter))
        self.header = [name.strip() for name in first_row]
        if self.options.header:
            next(reader)
        else:
            self.header = [str(number + 1) for number in range(len(first_row))]
        places = {name: self._place(name) for name in self.names}
        time = None if self.clock is None else self._place(self.clock.column)
        rows = self._rows(reader)
        while batch := list(islice(rows, _BATCH)):
            for name, place in places.items():
                self.parts[name].append(self._numbers(name, [(line, row[place]) for line, row in batch]))
            if time is not None:
                self.stamps += [self._stamp(line, row[time]) for line, row in batch]
        columns = {name: self._joined(name) for name in self.names}
        stamps = None if time is None else np.array(self.stamps, dtype=np.int64)
        return RecordedTable(columns, stamps, self.losses)

    def _place(self, name: str) -> int:
        if name not in self.header:
            raise _no_column(self.path, name, self.header)
        return self.header.index(name)

    def _rows(self, reader: Any) -> Iterator[tuple[int, list[str]]]:
        """Rows with their line numbers; a last row that the end of the file cuts is a loss."""
        for row in reader:
            if not row:
                continue
            if len(row) == len(self.header):
                yield reader.line_num, row
                continue
            line = reader.line_num
            if len(row) < len(self.header) and next(reader, None) is None and not self._ends_with_newline():
                sentence = f"{self.path.name}: the last line ({line}) is cut and was skipped"
                size = self.path.stat().st_size
                self.losses.append(Loss(LossKind.TRUNCATED, size, None, None, sentence, 1, self.path))
                return
            sentence = f"{self.path}: line {line} has {len(row)} cells for {len(self.header)} columns: correct the line"
            raise InputError(ErrorCode.FILE_CORRUPT, sentence)

    def _ends_with_newline(self) -> bool:
        with self.path.open("rb") as file:
            file.seek(-1, 2)
            return file.read() == b"\n"

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
        return np.nan if cell in self.missing else float(cell)

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
            value = Decimal(cell.strip()) * (1 if self.clock is None else self.clock.unit)
            if abs(value) < _MAX_STAMP:
                return round(value)
            problem = "is beyond the year 2038: correct time.unit"
        except (ArithmeticError, ValueError):
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


def _no_column(path: Path, name: str, there: Sequence[str]) -> InputError:
    listed = ", ".join(there[:30]) + (", ..." if len(there) > 30 else "")
    return InputError(ErrorCode.BAD_INPUT, f"{path} has no column {name!r}: correct the mapping; it has {listed}")


# -- arrays ---------------------------------------------------------------------------------------------------


def _read_arrays(path: Path, names: Sequence[str], clock: Clock | None) -> RecordedTable:
    wanted = [*names, *([clock.column] if clock else [])]
    read = _read_mat if path.suffix.lower() == ".mat" else _read_npz
    try:
        arrays = read(path, wanted)
    except InputError:
        raise
    except Exception as error:  # the libraries raise errors of many kinds for damaged files
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path} is damaged ({reason_of(error)}): copy it again") from error
    rows = {name: array.shape[0] for name, array in arrays.items()}
    if len(set(rows.values())) != 1 or not min(rows.values()):
        listed = ", ".join(f"{name} {count}" for name, count in rows.items())
        raise InputError(ErrorCode.SHAPE_MISMATCH, f"{path}: the arrays differ in their numbers of rows: {listed}")
    stamps = None if clock is None else _array_stamps(path, arrays[clock.column], clock)
    return RecordedTable({name: np.asarray(arrays[name], dtype=np.float64) for name in names}, stamps)


def _array_stamps(path: Path, values: npt.NDArray[Any], clock: Clock) -> Stamps:
    if values.shape[1] != 1:
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: {clock.column} is not a row of times: correct the mapping")
    times = values[:, 0]
    if not np.isfinite(times).all() or (np.abs(times.astype(np.float64)) * clock.unit >= _MAX_STAMP).any():
        sentence = f"{path}: {clock.column} holds times that are not finite or beyond the year 2038: correct time.unit"
        raise InputError(ErrorCode.FILE_CORRUPT, sentence)
    if times.dtype.kind in "iu":
        return np.asarray(times.astype(np.int64) * clock.unit)
    return np.rint(times.astype(np.float64) * clock.unit).astype(np.int64)


def _as_rows(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """(N, K) of an array of at most two dimensions; a single row counts as a column."""
    if array.ndim > 2 or array.dtype.kind not in "fiu":
        raise ValueError(f"an array of {array.ndim} dimensions and type {array.dtype} is not a table of numbers")
    return array.reshape(-1, 1) if array.ndim < 2 or array.shape[0] == 1 else array


def _read_mat(path: Path, names: Sequence[str]) -> dict[str, npt.NDArray[Any]]:
    """Read arrays of a MATLAB file, version 7 or older."""
    from scipy.io import loadmat, whosmat

    with path.open("rb") as file:
        if file.read(len(HDF5)) == HDF5:
            raise InputError(ErrorCode.UNSUPPORTED, f"{path} is a MATLAB 7.3 file: save it with `save -v7`")
        _check_mat_size(path, file)
    classes = {name: kind for name, _, kind in whosmat(path)}
    for name in names:
        if name not in classes:
            raise _no_column(path, name, list(classes))
        if classes[name] not in _NUMBER_CLASSES:
            sentence = f"{path}: {name} is of class {classes[name]}, not an array of numbers: name another"
            raise InputError(ErrorCode.UNSUPPORTED, sentence)
    content = loadmat(path, variable_names=list(names))
    return {name: _as_rows(content[name]) for name in names}


def _check_mat_size(path: Path, file: BinaryIO) -> None:
    """Decompress each element of the file in pieces, to bound what loading it costs."""
    budget = UnpackingBudget(path, path.stat().st_size)
    file.seek(MAT_HEAD - 2)
    order = "<" if file.read(2) == b"IM" else ">"
    while len(tag := file.read(8)) == 8:
        kind, size = (int(number) for number in np.frombuffer(tag, order + "u4"))
        payload = file.read(size)
        stream = zlib.decompressobj()
        while kind == MAT_COMPRESSED and (piece := stream.decompress(payload, PIECE)):
            budget.spend(len(piece))
            payload = stream.unconsumed_tail


def _read_npz(path: Path, names: Sequence[str]) -> dict[str, npt.NDArray[Any]]:
    """Read arrays of a NumPy archive; nothing is unpickled."""
    budget = UnpackingBudget(path, path.stat().st_size)
    arrays = {}
    with zipfile.ZipFile(path) as archive:
        there = [name.removesuffix(".npy") for name in archive.namelist()]
        for name in names:
            if name not in there:
                raise _no_column(path, name, there)
            budget.spend(archive.getinfo(name + ".npy").file_size)
            with archive.open(name + ".npy") as member:
                version = np.lib.format.read_magic(member)
                head = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, fortran, dtype = head(member)
                if dtype.kind not in "fiu":
                    raise ValueError(f"{name} holds {dtype}, not numbers")
                values = np.frombuffer(member.read(), dtype).reshape(shape, order="F" if fortran else "C")
                arrays[name] = _as_rows(values)
    return arrays
