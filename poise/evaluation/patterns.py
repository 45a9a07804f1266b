"""What stands out in many answers: sources far from the others of their group, and quantities that change with time."""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from poise.evaluation.rows import Row
from poise.types import Array

_FEW = 8
"""Members of a group below which nothing is said about it."""
_FAR = 3.5
"""Modified z score of an outlier (Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993)."""
_FALSE_SHARE = 0.01
"""Of the changes that are reported, the share that chance alone makes (Benjamini and Hochberg)."""
_NOTABLE = 2.0
"""Size of a reported change, in standard deviations of the values before and after it."""
_NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


@dataclass(frozen=True)
class Outlier:
    """A source far from the others of its group: in which column, by how many robust standard deviations."""

    row: Row
    column: str
    value: float
    usual: float
    score: float


@dataclass(frozen=True)
class Change:
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
    rows: tuple[Row, ...]
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
        return (
            f"{where}{self.column} changed {when} from {self.before:.4g} to {self.after:.4g}{self._factor} ({counts})"
        )

    @property
    def _factor(self) -> str:
        if self.before * self.after <= 0:
            return ""
        return f", {self.after / self.before:.2g} times"


def measures_in(columns: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """The columns that a job's patterns choose, in the order of the patterns."""
    return [column for pattern in patterns for column in columns if fnmatchcase(column, pattern)]


def outliers(rows: Iterable[Row], measures: Sequence[str]) -> list[Outlier]:
    """The sources that are far from the median of their group in some column, the farthest first.

    The score is 0.6745 |x - median| / MAD within groups of eight or more; where more than half of the values are
    equal, the mean absolute deviation takes the place of the MAD.
    """
    worst: dict[str, Outlier] = {}
    for column in measures:
        for _, members in _groups(rows):
            values = np.array([row.number(column) for row in members])
            usual, scores = _scores(values)
            for at in np.flatnonzero(scores > _FAR).tolist():
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


def changes(rows: Iterable[Row], measures: Sequence[str]) -> list[Change]:
    """The quantities of each group that changed at some time, the most certain first.

    Each column of each group of eight or more is tested with Pettitt's rank test (A. N. Pettitt, A non-parametric
    approach to the change-point problem, Applied Statistics 28, 1979); of all changes that are reported, 1 % are
    expected to be chance, and each is at least twice the spread.
    """
    found = []
    for group, members in _groups(rows):
        dated = sorted((row for row in members if math.isfinite(row.time)), key=lambda row: (row.time, row.name))
        for column in measures:
            values = np.array([row.number(column) for row in dated])
            known = np.flatnonzero(np.isfinite(values))
            if len(known) >= _FEW and np.ptp(values[known]) > 0:
                index, probability = pettitt(values[known])
                chosen = tuple(dated[at] for at in known)
                before, after = np.split(values[known], [index])
                middle = float(np.median(before)), float(np.median(after))
                found.append((Change(group, column, chosen, index, *middle, probability), before, after))
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


def _is_notable(change: Change, before: Array, after: Array) -> bool:
    spread = _NORMAL * float(np.median(np.concatenate([abs(before - change.before), abs(after - change.after)])))
    return abs(change.after - change.before) > max(_NOTABLE * spread, 1e-9 * abs(change.before))


def pettitt(values: Array) -> tuple[int, float]:
    """Pettitt's change point: the index of the first value after it, and the probability of it without a change.

    Args:
        values: (N,) in the order of time.
    """
    from scipy.stats import rankdata  # it loads slowly, and workers do not need it

    count = len(values)
    larger_than = 2.0 * rankdata(values) - (count + 1)  # of each: values below it less values above it
    statistic = np.abs(np.cumsum(larger_than)[:-1])
    index = int(statistic.argmax()) + 1
    exponent = -6.0 * float(statistic.max()) ** 2 / (count**3 + count**2)
    return index, min(1.0, 2.0 * math.exp(exponent))


def _groups(rows: Iterable[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Rows with answers by their groups."""
    members: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if row.counts:
            members[row.group].append(row)
    yield from sorted(members.items())
