"""What stands out in many answers: sources far from the others of their group, and quantities that change with time."""

import math
import warnings
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import pairwise

import numpy as np

from poise.evaluation.rows import ResultRow, spoken
from poise.types import Array

_FEW = 8
"""Members of a group below which nothing is said about it."""
_FAR = 3.5
"""Modified z score of an outlier (Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993)."""
_FALSE_SHARE = 0.01
"""Of the changes that are reported, the share that chance alone makes (Benjamini and Hochberg)."""
_NOTABLE = 2.0
"""Size of a reported change, in standard deviations of the values before and after it."""
_EFFICIENCY, _CHANCE = 0.37, 0.5
"""Of the MAD of normal values, and the number of outliers that chance may make in an evaluation."""
_TRIMMED, _BLOCKS, _SIDE = 0.2, 200, 3
"""Share of values that a trimmed mean leaves out at each end, most values that a change is looked for in, and the least
number on each side of it."""
_NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


@dataclass(frozen=True)
class Outlier:
    """A source far from the others of its group: in which column, by how many robust standard deviations."""

    row: ResultRow
    column: str
    value: float
    usual: float
    score: float


@dataclass(frozen=True)
class LevelChange:
    """A quantity of a group that is different from some time on.

    Args:
        group: such as a robot.
        column: the quantity.
        rows: of the group, in the order of time.
        index: of the first row after the change.
        before, after: medians.
        probability: that chance alone gives such a change in this column.
    """

    group: str
    column: str
    rows: tuple[ResultRow, ...]
    index: int
    before: float
    after: float
    probability: float

    @property
    def sentence(self) -> str:
        """In words, with dates and medians."""
        last, first = self.rows[self.index - 1].date[:10], self.rows[self.index].date[:10]
        where = f"{self.group}: " if self.group else ""
        counts = f"{self.index} recordings before, {len(self.rows) - self.index} after"
        when = f"on {first}" if last == first else f"between {last} and {first}"
        levels = f"from {self.before:.4g} to {self.after:.4g}{self._factor}"
        return f"{where}{spoken(self.column)} changed {when} {levels} ({counts})"

    @property
    def _factor(self) -> str:
        if self.before * self.after <= 0:
            return ""
        return f", {self.after / self.before:.2g} times"


def measures_in(columns: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """The columns that a job's patterns choose, in the order of the patterns."""
    return [column for pattern in patterns for column in columns if fnmatchcase(column, pattern)]


def outliers(rows: Iterable[ResultRow], measures: Sequence[str]) -> list[Outlier]:
    """The sources that are far from the median of their group in some column, the farthest first.

    The score is |x - median| over the MAD, in groups of eight or more; where more than half of the values are equal,
    the mean absolute deviation takes the place of the MAD. The limit is 3.5, or higher where chance alone would reach
    it in one of two evaluations: in small groups the MAD is uncertain, and many columns are looked at.
    """
    from scipy.stats import t as student  # it loads slowly, and workers do not need it

    groups = list(_groups(rows))
    looked_at = len(measures) * sum(len(members) for _, members in groups)
    worst: dict[str, Outlier] = {}
    for _, members in groups:
        freedom = max(_EFFICIENCY * (len(members) - 1), 1.0)
        limit = max(_FAR, float(student.isf(_CHANCE / max(2 * looked_at, 1), freedom)))
        for column in measures:
            values = np.array([row.number(column) for row in members])
            usual, scores = _scores(values)
            for at in np.flatnonzero(scores > limit).tolist():
                row = members[at]
                if row.name not in worst or worst[row.name].score < scores[at]:
                    worst[row.name] = Outlier(row, column, float(values[at]), usual, float(scores[at]))
    return sorted(worst.values(), key=lambda outlier: (-outlier.score, outlier.row.name))


def _scores(values: Array) -> tuple[float, Array]:
    known = values[np.isfinite(values)]
    if len(known) < _FEW:
        return math.nan, np.zeros(len(values))
    middle = float(np.median(known))
    away = np.abs(known - middle)
    spread = _NORMAL * float(np.median(away)) or 1.2533 * float(np.mean(away))
    if spread <= 1e-12 * abs(middle):
        return middle, np.zeros(len(values))
    return middle, np.nan_to_num(np.abs(values - middle) / spread)


def changes(rows: Iterable[ResultRow], measures: Sequence[str]) -> list[LevelChange]:
    """The quantities of each group that changed at some time, the most certain first.

    Each column of each group of eight or more is tested by `change_point`; of all changes that are reported, 1 % are
    expected to be chance, and each is at least twice the spread.
    """
    found = []
    for group, members in _groups(rows):
        dated = sorted((row for row in members if math.isfinite(row.time)), key=lambda row: (row.time, row.name))
        for column in measures:
            values = np.array([row.number(column) for row in dated])
            known = np.flatnonzero(np.isfinite(values))
            if len(known) >= _FEW and np.ptp(values[known]) > 0:
                index, probability = change_point(values[known])
                chosen = tuple(dated[at] for at in known)
                before, after = np.split(values[known], [index])
                middle = float(np.median(before)), float(np.median(after))
                found.append((LevelChange(group, column, chosen, index, *middle, probability), before, after))
    if not found:
        return []
    from scipy.stats import false_discovery_control  # it loads slowly, and workers do not need it

    adjusted = false_discovery_control([change.probability for change, *_ in found])
    sure = [
        change
        for (change, *parts), chance in zip(found, adjusted, strict=True)
        if chance < _FALSE_SHARE and _is_notable(change, *parts)
    ]
    return sorted(sure, key=lambda change: (change.probability, change.group, change.column))


def _is_notable(change: LevelChange, before: Array, after: Array) -> bool:
    spread = _NORMAL * float(np.median(np.concatenate([abs(before - change.before), abs(after - change.after)])))
    return abs(change.after - change.before) > max(_NOTABLE * spread, 1e-9 * abs(change.before))


def change_point(values: Array) -> tuple[int, float]:
    """Where a series is best described by two levels: the index of the first value after it, and its probability.

    The split has the least sum of absolute deviations from the medians of both parts, each of three values or more.
    Its probability by chance is that of their trimmed means (K. K. Yuen, The two-sample trimmed t for unequal
    population variances, Biometrika 61, 1974), which outliers hardly move, times the number of splits. A series of
    over 200 values is first reduced to medians of blocks.

    Args:
        values: (N,) in the order of time, N >= 6.
    """
    from scipy.stats import ttest_ind  # it loads slowly, and workers do not need it

    starts = np.unique(np.linspace(0, len(values), min(len(values), _BLOCKS) + 1).astype(int))
    medians = np.array([np.median(values[start:end]) for start, end in pairwise(starts)])
    splits = range(_SIDE, len(medians) - _SIDE + 1)
    costs = [_deviations(medians[:at]) + _deviations(medians[at:]) for at in splits]
    best = splits[int(np.argmin(costs))]
    before, after = medians[:best], medians[best:]
    with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # parts without a spread are judged below
        chance = float(ttest_ind(before, after, equal_var=False, trim=_TRIMMED).pvalue)
    if not math.isfinite(chance):  # neither part has a spread
        chance = 0.0 if np.median(before) != np.median(after) else 1.0
    return int(starts[best]), min(1.0, chance * len(splits))


def _deviations(values: Array) -> float:
    return float(np.abs(values - np.median(values)).sum())


def _groups(rows: Iterable[ResultRow]) -> Iterator[tuple[str, list[ResultRow]]]:
    """Rows with answers by their groups."""
    members: dict[str, list[ResultRow]] = defaultdict(list)
    for row in rows:
        if row.counts:
            members[row.group].append(row)
    yield from sorted(members.items())
