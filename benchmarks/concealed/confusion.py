"""The confusion matrix: what was there, and what was named first."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np

from benchmarks.concealed.changes import LIBRARY
from benchmarks.concealed.tally import Verdict

matplotlib.use("Agg")
from matplotlib import pyplot as plt

NOTHING, OUTSIDE, SILENT = "none", "unknown", "no answer"
_DARK = 0.6
"""Share of a row from which its cell is too dark for black digits."""


def counts(
    verdicts: Sequence[Verdict],
) -> tuple[list[str], list[str], "np.ndarray[tuple[int, int], np.dtype[np.int64]]"]:
    """Rows (what was there), columns (what was named first) and how often; singles, nulls, decoys, off-library."""
    seen: Counter[tuple[str, str]] = Counter()
    for verdict in verdicts:
        there = {"null": NOTHING, "decoy": "a decoy", "foreign": OUTSIDE}.get(verdict.kind)
        if verdict.kind == "single":
            there = verdict.truth[0]
        if there is not None:
            seen[there, verdict.first or SILENT] += 1
    rows = [name for name in [*LIBRARY, NOTHING, "a decoy", OUTSIDE] if any(row == name for row, _ in seen)]
    columns = [*LIBRARY, NOTHING, OUTSIDE]
    columns += sorted({column for _, column in seen} - set(columns))
    table = np.array([[seen[row, column] for column in columns] for row in rows], dtype=np.int64)
    used = (table.sum(axis=0) > 0) | np.isin(columns, rows) if len(rows) else np.zeros(len(columns), dtype=bool)
    return rows, [c for c, keep in zip(columns, used, strict=True) if keep], table.reshape(-1, len(columns))[:, used]


def draw(path: Path, verdicts: Sequence[Verdict]) -> None:
    """A picture of `counts`, each row by its own total."""
    rows, columns, table = counts(verdicts)
    if not rows:
        return
    figure, axes = plt.subplots(figsize=(2.5 + 0.27 * len(columns), 2.2 + 0.24 * len(rows)), layout="constrained")
    shares = table / table.sum(axis=1, keepdims=True)
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), count in np.ndenumerate(table):
        if count:
            colour = "white" if shares[i, j] > _DARK else "black"
            axes.text(j, i, str(count), ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    axes.set_xlabel("named first")
    axes.set_ylabel("what was there")
    unfinished = path.with_name(f".{path.name}.partial")
    figure.savefig(unfinished, dpi=130, format="png")
    plt.close(figure)
    unfinished.replace(path)
