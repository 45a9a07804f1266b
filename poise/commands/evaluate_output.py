"""What `poise evaluate` prints and writes: JSON, tables, the page, and a summary for people."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from poise.evaluation import (
    ErrorLine,
    EvaluationJob,
    Journal,
    LevelChange,
    Outlier,
    ResultRow,
    add_truths,
    changes,
    columns_of,
    error_lines,
    failures_of,
    measures_in,
    outliers,
    rows_of,
    spoken,
    write_tables,
)
from poise.viewing import readable, rounded

_SHOWN = 40
"""Lines of a table on the terminal."""


@dataclass(frozen=True)
class Results:
    """The rows of an evaluation and what stands out in them."""

    rows: list[ResultRow]
    outliers: list[Outlier]
    changes: list[LevelChange]
    errors: list[ErrorLine]
    written: list[Path]

    @property
    def exit_status(self) -> int:
        """That of the worst source."""
        return max((int(row.error["exit_status"]) for row in self.rows if row.error), default=0)


def results_json(journal: Journal, skipped: list[str]) -> dict[str, Any]:
    """The answers of all sources, each as the job writes it, in the order of their names."""
    entries = {entry["name"]: entry for entry in journal.entries()}
    return {"recordings": [_one_json(entries[name]) for name in sorted(entries)], "skipped": skipped}


def _one_json(entry: dict[str, Any]) -> dict[str, Any]:
    content = {"bag": entry["name"]} | (entry["answer"] or {})
    if entry["error"] is not None:
        content["error"] = {key: entry["error"][key] for key in ("code", "name", "message")}
    return content


def write_results(folder: Path | None, journal: Journal, job: EvaluationJob, groups: dict[str, str]) -> Results:
    """The results of a journal, written as tables and a page into a folder; None: nowhere.

    Raises:
        InputError: FILE_UNWRITABLE; FILE_CORRUPT for a truth file.
    """
    rows = rows_of(journal.entries(), groups)
    add_truths(rows, job.kind)
    measures = measures_in(columns_of(rows), job.measures)
    found = Results(rows, outliers(rows, measures), changes(rows, measures), error_lines(rows), [])
    if folder is not None:
        # Drawing libraries load slowly: they are imported on use.
        from poise.viewing import write_evaluation_report

        found.written.extend(write_tables(folder, rows))
        page = write_evaluation_report(folder, job.name, rows, measures, found.outliers, found.changes, found.errors)
        found.written.append(page)
    return found


def print_results(people: Console, job: EvaluationJob, found: Results, skipped: Sequence[str]) -> None:
    """The results as text: what changed, what stands out, what failed, and of a few sources each answer."""
    if job.name == "identify" and len(found.rows) <= _SHOWN:
        people.print(_payloads(found.rows))
    answered = sum(row.error is None for row in found.rows)
    people.print(f"{answered} of {len(found.rows)} answered")
    for kind, count, row in failures_of(found.rows):
        message = readable(str(row.error["message"]), 300) if row.error else ""
        people.print(f"{count} {kind}, for example {escape(message)}", soft_wrap=True)
    for row in found.rows:
        if row.duplicate_of:
            people.print(escape(f"{row.name} has the same content as {row.duplicate_of}"), soft_wrap=True)
    for change in found.changes[:_SHOWN]:
        people.print(escape(change.sentence), soft_wrap=True)
    if found.outliers:
        people.print(_far(found.outliers[:_SHOWN]))
    if found.errors:
        people.print(error_table(found.errors))
    if skipped:
        kind = f"{job.kind.name}s"
        names = readable(", ".join(skipped), 500)
        people.print(f"skipped, because they are no {kind}: {escape(names)}", soft_wrap=True)
    for path in found.written:
        people.print(f"written: {escape(str(path))}", soft_wrap=True)


def _far(found: Sequence[Outlier]) -> Table:
    table = Table("outlier", "field", title="Far from the others of their group", title_justify="left")
    for heading in ("value", "usual", "robust sigmas"):
        table.add_column(heading, justify="right")
    for each in found:
        numbers = f"{each.value:.4g}", f"{each.usual:.4g}", f"{each.score:.1f}"
        table.add_row(escape(readable(each.row.name)), spoken(each.column), *numbers)
    return table


def error_table(errors: Sequence[ErrorLine]) -> Table:
    """Answers against truth files."""
    table = Table("field", title="Errors against the truth files", title_justify="left")
    for heading in ("sources", "mean error", "rms", "median size", "worst", "in 95 % interval", "equal"):
        table.add_column(heading, justify="right")
    for line in errors:
        numbers = (line.bias, line.rms, line.median, line.worst)
        cells = [f"{value:.3g}" if math.isfinite(value) else "" for value in numbers]
        shares = [f"{100 * share:.0f} %" if math.isfinite(share) else "" for share in (line.covered, line.agreeing)]
        table.add_row(escape(line.field), str(line.count), *cells, *shares)
    return table


def _payloads(rows: Sequence[ResultRow]) -> Table:
    table = Table()
    for heading in ("recording", "method", "mass kg", "centre of mass mm", "residual N, mN m", "samples", "findings"):
        words = heading in ("recording", "method", "findings")
        table.add_column(heading, justify="left" if words else "right")
    for row in rows:
        name, found = escape(readable(Path(row.name).name)), str(row.cells.get("findings", ""))
        if row.error is not None:
            table.add_row(name, "", "-", "", "", "", found or row.error["name"].lower(), style="red")
            continue
        mass, sigma = rounded(row.number("mass"), row.number("mass_std"))
        com = ", ".join(_millimetres(row, axis) for axis in range(3))
        residual = f"{row.number('residual_force'):.3f}, {1e3 * row.number('residual_torque'):.1f}"
        samples = str(row.cells.get("n_samples", ""))
        table.add_row(name, str(row.cells["method"]), f"{mass} ± {sigma}", com, residual, samples, found)
    return table


def _millimetres(row: ResultRow, axis: int) -> str:
    value = 1e3 * row.number(f"com.{axis}")
    return rounded(value, 1e3 * row.number(f"com_std.{axis}"))[0] if math.isfinite(value) else "-"
