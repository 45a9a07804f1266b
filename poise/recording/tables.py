"""Reading columns of numbers from text tables (CSV), MATLAB files and NumPy archives."""

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from poise.errors import ErrorCode, InputError
from poise.recording.blocks import PIECE
from poise.recording.contents import UnpackingBudget, reason_of
from poise.recording.mapping import Clock, TextFormat
from poise.recording.text_tables import MAX_STAMP, RecordedTable, no_column, read_text
from poise.types import Stamps

_NUMBER_CLASSES = ("double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
MAT_HEAD, MAT_COMPRESSED, HDF5 = 128, 15, b"\x89HDF"


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
        return read_text(path, wanted, time, text)
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error


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
    if not np.isfinite(times).all() or (np.abs(times.astype(np.float64)) * clock.unit >= MAX_STAMP).any():
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
            raise no_column(path, name, list(classes))
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
                raise no_column(path, name, there)
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
