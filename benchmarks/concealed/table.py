"""The issue's table: each goal with what was reached, over all verdicts."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.concealed.tally import MOVING_PARTS, SENSOR_EFFECTS, Verdict

BINS = 10  # of the calibration error


@dataclass(frozen=True)
class Row:
    """One line: what, how many cases it is from, the goal, and what was reached (None: nothing to judge)."""

    what: str
    count: int
    goal: str
    reached: float | None
    unit: str
    met: bool | None

    def cell(self) -> str:
        """The number as people read it."""
        if self.reached is None:
            return "-"
        scaled = {"%": 100.0, "ms": 1000.0}.get(self.unit, 1.0) * self.reached
        return f"{scaled:.{1 if abs(scaled) >= 10 else 3 if self.unit == '' else 2}f} {self.unit}".strip()


def score(verdicts: Sequence[Verdict], times: Mapping[str, Mapping[str, Any]]) -> list[Row]:
    """All rows.

    Args:
        verdicts: of all cases.
        times: by case, {seconds: s of the whole process} of `run`.
    """
    kinds = {kind: [v for v in verdicts if v.kind == kind] for kind in KINDS}
    singles = {strength: [v for v in kinds["single"] if v.strength == strength] for strength in (1.0, 0.3)}
    plain = singles[1.0]
    rows = [
        _share("one effect at 1.0: named first", plain, _right, 0.95),
        _share("one effect at 0.3: named first", singles[0.3], _right, 0.88),
        _share("pairs: both named", kinds["pair"], _right, 0.80),
        _share("pairs: no extra name", kinds["pair"], lambda v: v.answered and not v.extra, 0.90),
        _share("nulls: false alarms", kinds["null"], lambda v: not v.right, 0.01, most=True),
        _share("decoys: false alarms", kinds["decoy"], lambda v: not v.right, 0.03, most=True),
        _share("off-library: unknown or mixed", kinds["foreign"], _right, 0.95),
        _share("off-library: right dependency", kinds["foreign"], lambda v: v.dependency, 0.90),
        _share("twins: one of them named first", kinds["twin"], _right, None),
        _share("twins: and the other one listed", kinds["twin"], lambda v: v.right and v.says_so, None),
        _share("one effect: extra name beside it", kinds["single"], lambda v: v.extra and v.right, None),
        _mean("contact: windows, intersection over union", (v.overlap for v in verdicts), 0.85, ""),
        _median("mass_step: error of its time", (v.time_error for v in verdicts), 0.010, "ms"),
        _median("parameters at 1.0: sensor, calibration", _errors(plain, SENSOR_EFFECTS), 0.02, "%"),
        _median("parameters at 1.0: moving parts", _errors(plain, MOVING_PARTS), 0.08, "%"),
        _median("parameters at 1.0: all others", _errors(plain, (), SENSOR_EFFECTS + MOVING_PARTS), None, "%"),
        _median("excess held-out error removed at 1.0", (v.removed for v in plain), 0.95, "%", most=False),
    ]
    stated = [pair for verdict in verdicts for pair in verdict.stated]
    rows += [
        _row("expected calibration error", len(stated), calibration_error(stated), 0.03, "", most=True),
        _row("Brier score", len(stated), brier(stated), 0.06, "", most=True),
        _median("time per recording, the tool's account", (v.seconds for v in verdicts), 3.0, "s"),
        _median("time per recording, whole process", (entry["seconds"] for entry in times.values()), None, "s"),
        _share("bags without an answer", verdicts, lambda v: not v.answered, None),
    ]
    return rows


KINDS = ("single", "pair", "null", "decoy", "twin", "foreign")


def calibration_error(stated: Sequence[tuple[float, bool]]) -> float | None:
    """Expected calibration error: mean over ten equal bins of |stated - true share|, weighted by their counts."""
    if not stated:
        return None
    probability, true = (np.array(column, dtype=np.float64) for column in zip(*stated, strict=True))
    where = np.minimum((probability * BINS).astype(int), BINS - 1)
    gaps = [abs(float((probability - true)[where == b].sum())) for b in range(BINS)]
    return sum(gaps) / len(stated)


def brier(stated: Sequence[tuple[float, bool]]) -> float | None:
    """Mean squared difference of stated probability and truth (Brier 1950)."""
    return float(np.mean([(p - true) ** 2 for p, true in stated])) if stated else None


def rendered(rows: Iterable[Row]) -> Table:
    """For the console."""
    made = Table(title="Concealed effects", title_justify="left")
    for heading in ("", "cases", "goal", "reached"):
        made.add_column(heading, justify="left" if not heading else "right")
    for row in rows:
        style = {True: "green", False: "red", None: ""}[row.met]
        made.add_row(row.what, str(row.count), row.goal, f"[{style}]{row.cell()}[/]" if style else row.cell())
    return made


def _right(verdict: Verdict) -> bool:
    return verdict.right


def _errors(verdicts: Iterable[Verdict], names: Sequence[str], but: Sequence[str] = ()) -> list[float]:
    return [
        error
        for verdict in verdicts
        for (name, _), error in verdict.errors.items()
        if (name in names or not names) and name not in but
    ]


def _share(
    what: str,
    verdicts: Sequence[Verdict],
    hit: Callable[[Verdict], bool],
    goal: float | None,
    most: bool = False,
) -> Row:
    reached = float(np.mean([hit(verdict) for verdict in verdicts])) if verdicts else None
    return _row(what, len(verdicts), reached, goal, "%", most)


def _mean(what: str, values: Iterable[float | None], goal: float | None, unit: str) -> Row:
    known = [value for value in values if value is not None]
    return _row(what, len(known), float(np.mean(known)) if known else None, goal, unit, most=False)


def _median(what: str, values: Iterable[float | None], goal: float | None, unit: str, most: bool = True) -> Row:
    known = [value for value in values if value is not None]
    return _row(what, len(known), float(np.median(known)) if known else None, goal, unit, most)


def _row(what: str, count: int, reached: float | None, goal: float | None, unit: str, most: bool) -> Row:
    if goal is None:
        return Row(what, count, "", reached, unit, None)
    words = f"{'<=' if most else '>='} {goal * {'%': 100, 'ms': 1000}.get(unit, 1):g} {unit}".strip()
    met = None if reached is None else bool(reached <= goal if most else reached >= goal)
    return Row(what, count, words, reached, unit, met)
