"""Tables of results as CSV, and as Parquet where pyarrow is installed."""

import csv
import io
import math
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from poise.evaluation.rows import ResultCell, ResultRow, columns_of
from poise.files import write_whole

_ABOUT = ("name", "group", "time", "error", "message", "sha256", "duplicate_of", "job_seconds")
"""Columns of every table, before those of the answers."""
_FORMULA = ("=", "+", "-", "@", "\t")


def write_tables(folder: Path, rows: Sequence[ResultRow]) -> list[Path]:
    """Write results.csv and, with pyarrow, results.parquet: a row for each source, empty cells where it has no value.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    columns = columns_of(rows)
    written = [write_whole(folder / "results.csv", _csv(rows, columns).encode())]
    if find_spec("pyarrow") is not None:
        written.append(write_whole(folder / "results.parquet", _parquet(rows, columns)))
    return written


def _about(row: ResultRow) -> tuple[str | float, ...]:
    error = row.error or {}
    seconds = row.seconds if math.isfinite(row.seconds) else ""
    return (
        row.name,
        row.group,
        row.date,
        error.get("name", ""),
        error.get("message", ""),
        row.sha256,
        row.duplicate_of,
        seconds,
    )


def _csv(rows: Sequence[ResultRow], columns: Sequence[str]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*_ABOUT, *columns])
    for row in rows:
        cells = (*_about(row), *(row.cells.get(column, "") for column in columns))
        writer.writerow([_inert(cell) for cell in cells])
    return text.getvalue()


def _inert(cell: ResultCell) -> ResultCell:
    """Words that a spreadsheet would take for a formula get a quote in front."""
    return f"'{cell}" if isinstance(cell, str) and cell[:1] in _FORMULA and cell != "-inf" else cell


def _parquet(rows: Sequence[ResultRow], columns: Sequence[str]) -> bytes:
    import pyarrow
    import pyarrow.parquet

    about = list(zip(*(_about(row) for row in rows), strict=True)) or [()] * len(_ABOUT)
    content: dict[str, Any] = {name: list(values) for name, values in zip(_ABOUT, about, strict=True)}
    content["time"] = [row.time if math.isfinite(row.time) else None for row in rows]
    content["job_seconds"] = [row.seconds if math.isfinite(row.seconds) else None for row in rows]
    for column in columns:
        values = [row.cells.get(column) for row in rows]
        kinds = {type(value) for value in values if value is not None}
        if kinds == {int, float}:
            values = [None if value is None else float(value) for value in values]
        elif len(kinds) > 1:
            values = [None if value is None else str(value) for value in values]
        content[column] = values
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(content), buffer)
    return buffer.getvalue()
