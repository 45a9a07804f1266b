"""The HTML page of an evaluation: what changed with time, what stands out, distributions, errors, failures."""

import math
import shlex
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from poise.evaluation import ErrorLine, LevelChange, Outlier, ResultRow, failures_of, median_seconds, spoken
from poise.files import write_whole
from poise.viewing.evaluation_figures import change_panel, distribution_panel
from poise.viewing.page import Finding, drawn, making, render_page
from poise.viewing.wording import counted, readable

_LINES, _PANELS = 60, 18
"""Lines of a table and panels of a section at most; the tables of results have all."""


def write_evaluation_report(
    directory: Path,
    job: str,
    rows: Sequence[ResultRow],
    measures: Sequence[str],
    outliers: Sequence[Outlier],
    changes: Sequence[LevelChange],
    errors: Sequence[ErrorLine],
    *,
    command: str | None = None,
    now: datetime | None = None,
) -> Path:
    """Write `index.html`; the file is self-contained and loads nothing from the network.

    Args:
        directory: made when missing.
        job: subcommand that was run.
        rows: one for each source.
        measures: columns whose distributions are drawn.
        outliers, changes: what stands out, the strongest first.
        errors: against truth files.
        command: that made it; default: this process's command line.
        now: date shown; default: the current time.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    command = shlex.join(sys.argv) if command is None else command
    answered = sum(row.error is None for row in rows)
    histograms = [distribution_panel(number, column, rows) for number, column in enumerate(measures)]
    page = render_page(
        "evaluation.html.j2",
        title=f"{job} of {counted(len(rows), 'source')}",
        kicker="Evaluation",
        verdict=f"{answered} of {len(rows)} answered",
        sentence=_headline(changes, outliers),
        findings=_findings(rows, changes, outliers),
        changes=drawn([change_panel(number, change) for number, change in enumerate(changes[:_PANELS])]),
        sentences=[readable(change.sentence, 300) for change in changes[:_LINES]],
        outliers=[_outlier(each) for each in outliers[:_LINES]],
        errors=[_error(line) for line in errors],
        distributions=drawn([panel for panel in histograms if panel is not None][:_PANELS]),
        failures=[_failure(row) for row in rows if row.error is not None][:_LINES],
        provenance=[*making(command, now or datetime.now(UTC)), ("s for a source", f"{median_seconds(rows):.3g}")],
        data={"job": job, "sources": len(rows), "answered": answered},
        data_id="evaluation",
    )
    return write_whole(Path(directory) / "index.html", page.encode("utf-8"))


def _headline(changes: Sequence[LevelChange], outliers: Sequence[Outlier]) -> str:
    if changes:
        return readable(changes[0].sentence, 300) + "."
    if outliers:
        first = outliers[0]
        where = f"{readable(first.row.name)} is the farthest from the others: {spoken(first.column)}"
        return f"Nothing changed with time. {where}."
    return "Nothing changed with time, and no source is far from the others of its group."


def _findings(rows: Sequence[ResultRow], changes: Sequence[LevelChange], outliers: Sequence[Outlier]) -> list[Finding]:
    findings = [Finding("warn", readable(change.sentence, 300)) for change in changes[1:6]]
    if outliers:
        findings.append(Finding("warn", f"{counted(len(outliers), 'source')} far from the others of their group."))
    for kind, count, row in failures_of(rows):
        findings.append(Finding("warn", f"{count} {kind}, for example {readable(row.name)}."))
    duplicates = sum(bool(row.duplicate_of) for row in rows)
    if duplicates:
        text = f"{counted(duplicates, 'source')} with the content of another one; they count once."
        findings.append(Finding("note", text))
    return findings or [Finding("good", "Every source has an answer.")]


def _outlier(each: Outlier) -> dict[str, Any]:
    numbers = {"value": f"{each.value:.4g}", "usual": f"{each.usual:.4g}", "score": f"{each.score:.1f}"}
    return {
        "name": readable(each.row.name),
        "group": readable(each.row.group),
        "column": spoken(each.column),
        **numbers,
    }


def _error(line: ErrorLine) -> dict[str, str]:
    numbers = {"bias": line.bias, "rms": line.rms, "median": line.median, "worst": line.worst}
    shares = {"covered": line.covered, "agreeing": line.agreeing}
    return {
        "field": readable(line.field),
        "count": str(line.count),
        "name": readable(line.worst_name),
        **{key: f"{value:.3g}" if math.isfinite(value) else "" for key, value in numbers.items()},
        **{key: f"{100 * share:.0f} %" if math.isfinite(share) else "" for key, share in shares.items()},
    }


def _failure(row: ResultRow) -> dict[str, str]:
    error = row.error or {}
    return {"name": readable(row.name), "kind": error["name"], "message": readable(error["message"], 400)}
