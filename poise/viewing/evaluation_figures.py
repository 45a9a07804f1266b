"""The figures of an evaluation: distributions of quantities, and quantities over the time of recording."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
from matplotlib.dates import DateFormatter
from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator

from poise.evaluation import LevelChange, ResultRow, spoken
from poise.viewing.canvas import PALETTE, Panel, add_axes
from poise.viewing.wording import readable

_DATE: Any = DateFormatter("%Y-%m-%d")  # type: ignore[no-untyped-call]
_BINS = 30
_POINTS = 2000
"""Points of a panel over time; of more, every so many-th is drawn."""


def distribution_panel(number: int, column: str, rows: Sequence[ResultRow]) -> Panel | None:
    """A histogram of a column; None where it has fewer than two different values."""
    values = np.array([row.number(column) for row in rows if row.counts])
    values = values[np.isfinite(values)]
    if len(values) < 2 or np.ptp(values) == 0:
        return None
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95)).tolist()
    title = readable(spoken(column), 60)
    alt = f"{title}: {len(values)} values, median {middle:.4g}, nine of ten between {low:.4g} and {high:.4g}."

    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, title, below=f"median {middle:.4g}")
        axes.hist(values, bins=min(_BINS, max(len(values) // 2, 2)), color=PALETTE["measured"])
        axes.axvline(middle, color=PALETTE["accent"], linewidth=1.8)

    return Panel(f"distribution-{number}", alt, draw)


def change_panel(number: int, change: LevelChange) -> Panel:
    """A quantity over the time of recording, with its medians before and after it changed."""
    days = [datetime.fromtimestamp(row.time, UTC) for row in change.rows]
    values = [row.number(change.column) for row in change.rows]
    step = math.ceil(len(days) / _POINTS)
    title = readable(f"{change.group} {spoken(change.column)}".strip(), 60)

    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, title, below="")
        axes.plot(days[::step], values[::step], "o", color=PALETTE["measured"], markersize=3.5, markeredgewidth=0)  # type: ignore[arg-type]
        halves = ((days[: change.index], change.before), (days[change.index :], change.after))
        for part, median in halves:
            axes.plot([part[0], part[-1]], [median, median], color=PALETTE["accent"], linewidth=2.2)  # type: ignore[arg-type]
        axes.tick_params(axis="x", labelsize=9)
        axes.xaxis.set_major_locator(MaxNLocator(3))
        axes.xaxis.set_major_formatter(_DATE)

    return Panel(f"change-{number}", change.sentence, draw)
