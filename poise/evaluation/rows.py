"""Rows of a table from the answers of a job: one for each source, and a column for each number and word in them."""

import math
import statistics
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

ResultCell = float | str | bool
_LONGEST = 12
"""Numbers of a list that become columns; longer lists stay in the journal."""
_SET_ASIDE = {
    *("covariance", "bias_covariance", "rejected", "segments", "where", "rivals", "basis", "windows", "contacts"),
    *("mechanism", "designed_motion", "recordings", "losses", "tests", "cannot_exclude", "bag", "cloud", "notes"),
    *("warnings", "untestable", "unproven"),
}
"""Fields that no table shows."""
_NAMED = ("effects", "findings", "input_findings")
"""Lists whose entries have a name; their names become one column."""
_FIRST_STAMP = 5e8
"""s since 1970 from which a stamp is a date, not the time of a simulation."""


@dataclass
class ResultRow:
    """What there is to know about one source.

    Args:
        name: path or URL.
        group: that it is compared within, such as the robot.
        time: s since 1970 of the recording, or of the file; NaN where unknown.
        error: code, name, message and exit_status of what prevents an answer; None: there is one.
        cells: the answer's numbers and words, by the path of their field.
        sha256: of the content.
        duplicate_of: name of an earlier source with the same content.
        truth: what is known to be true, by the path of its field.
    """

    name: str
    group: str
    time: float
    error: dict[str, Any] | None
    cells: dict[str, ResultCell]
    sha256: str = ""
    duplicate_of: str = ""
    truth: dict[str, ResultCell] = field(default_factory=dict)
    seconds: float = math.nan

    @property
    def counts(self) -> bool:
        """Whether it enters statistics: it has an answer of its own."""
        return self.error is None and not self.duplicate_of

    def number(self, column: str) -> float:
        """The number in a column; NaN where there is none. An effect that was not found has size 0."""
        value = self.cells.get(column)
        if isinstance(value, bool | str) or value is None:
            absent = self.error is None and column.startswith("effects.")
            return 0.0 if absent else math.nan
        return float(value)

    @property
    def date(self) -> str:
        """ISO date and time, UTC; empty where unknown."""
        return datetime.fromtimestamp(self.time, UTC).isoformat(timespec="seconds") if math.isfinite(self.time) else ""


def rows_of(entries: Iterable[dict[str, Any]], groups: dict[str, str]) -> list[ResultRow]:
    """The rows of a journal in the order of their names; of several replies about one source the last counts.

    Args:
        entries: of the journal.
        groups: by name of source.
    """
    rows = {entry["name"]: _row(entry, groups.get(entry["name"], "")) for entry in entries}
    ordered = [rows[name] for name in sorted(rows)]
    first: dict[str, str] = {}
    for row in ordered:
        if row.sha256:
            earlier = first.setdefault(row.sha256, row.name)
            row.duplicate_of = earlier if earlier != row.name else ""
    return ordered


def _row(entry: dict[str, Any], group: str) -> ResultRow:
    stamp, modified = entry.get("stamp"), entry["modified"]
    time = stamp if isinstance(stamp, float) and stamp > _FIRST_STAMP else modified
    return ResultRow(
        entry["name"],
        group,
        math.nan if time is None else float(time),
        entry["error"],
        flattened(entry["answer"] or {}),
        entry.get("sha256") or "",
        seconds=entry.get("seconds", math.nan),
    )


def flattened(content: dict[str, Any], above: str = "") -> dict[str, ResultCell]:
    """The numbers and words of an answer by the path of their field, such as `com.0` or `effects.NAME.probability`."""
    cells: dict[str, ResultCell] = {}
    for name, value in content.items():
        path = f"{above}{name}"
        if name in _SET_ASIDE or value is None:
            continue
        if isinstance(value, dict):
            cells |= flattened(value, f"{path}.")
        elif isinstance(value, list):
            cells |= _listed(value, name, path)
        else:
            cells[path] = value
    return cells


def _listed(values: list[Any], name: str, path: str) -> dict[str, ResultCell]:
    if name in _NAMED:
        entries = [value if isinstance(value, dict) else {"name": str(value)} for value in values]
        cells: dict[str, ResultCell] = {path: ", ".join(sorted(entry["name"].lower() for entry in entries))}
        if name == "effects":
            for entry in entries:
                cells |= flattened(
                    {key: value for key, value in entry.items() if key != "name"}, f"{path}.{entry['name']}."
                )
        return cells
    if not values or len(values) > _LONGEST:
        return {}
    if all(isinstance(value, str) for value in values):
        return {path: ", ".join(values)}
    if all(value is None or isinstance(value, int | float | dict) for value in values):
        return flattened({str(number): value for number, value in enumerate(values)}, f"{path}.")
    return {}


def columns_of(rows: Iterable[ResultRow]) -> list[str]:
    """All columns, in the order in which they appear first."""
    return list(dict.fromkeys(column for row in rows for column in row.cells))


def spoken(column: str) -> str:
    """A column in words: `effects.viscous_friction.parameters.damping_3.value` is `viscous_friction damping_3`."""
    return column.removeprefix("effects.").removesuffix(".value").replace(".parameters.", " ").replace(".change.", " ")


def failures_of(rows: Iterable[ResultRow]) -> list[tuple[str, int, ResultRow]]:
    """Each kind of error with its number, the most frequent first, and the first source that has it."""
    failed = [row for row in rows if row.error is not None]
    counts = Counter(_kind(row) for row in failed)
    return [(kind, count, next(row for row in failed if _kind(row) == kind)) for kind, count in counts.most_common()]


def _kind(row: ResultRow) -> str:
    return str(row.error["name"]) if row.error else ""


def median_seconds(rows: Iterable[ResultRow]) -> float:
    """s that a source took, in the middle."""
    seconds = [row.seconds for row in rows if math.isfinite(row.seconds)]
    return statistics.median(seconds) if seconds else math.nan
