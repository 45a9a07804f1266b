"""What all figures share: colours by role, plain axes, thinned curves, shaded intervals."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.files import write_whole
from poise.inertia.pipeline import Identification
from poise.types import Array
from poise.viewing.decimation import break_at_gaps, envelope

Draw = Callable[[FigureBase], None]

# Names of roles; the report turns them into CSS colours that follow the reader's light or dark scheme.
# x, y, z are red, green and blue as in RViz, in shades that colour-blind readers can distinguish.
PALETTE = {
    "ink": "#1b1f24",
    "muted": "#68707b",
    "grid": "#e4e7eb",
    "measured": "#a3abb6",
    "accent": "#2062d4",
    "rejected": "#b3261e",
    "axis-x": "#d55e01",
    "axis-y": "#00916b",
    "axis-z": "#0072b3",
}

STYLE: Any = {
    "font.size": 11,
    "svg.fonttype": "none",
    "svg.hashsalt": "poise",
    "path.simplify_threshold": 0.2,
    "axes.unicode_minus": False,
}

_UNDATED: Any = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
"""Metadata that would make equal pictures different files, by file ending."""

_PANEL = (360, 170)
"""Width and height of a panel, points: about the width of a phone, a third of a page."""

BINS = 240
"""Stretches that a series is thinned to: one per 1.2 points of a panel's width."""

SPARSE = 120
"""Up to so many samples each one is a mark; above, a line."""


@dataclass(frozen=True)
class Panel:
    """One picture: `draw` fills a figure or a part of one; `alt` says in words what it shows."""

    key: str
    alt: str
    draw: Draw
    size: tuple[int, int] = _PANEL

    def figure(self) -> Figure:
        """Draw the panel on its own (72 points an inch: one point is one CSS pixel of the report)."""
        figure = Figure(figsize=(self.size[0] / 72, self.size[1] / 72), dpi=72)
        self.draw(figure)
        return figure


def sheet(panels: Sequence[Panel], columns: int) -> Figure:
    """Draw panels of one size side by side on one figure, for a picture file."""
    width, height = panels[0].size
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(columns * width / 72, rows * height / 72), dpi=144)
    parts = figure.subfigures(rows, columns, squeeze=False).ravel()
    for panel, part in zip(panels, parts, strict=False):
        panel.draw(part)
    return figure


def write_picture(panels: Sequence[Panel], path: Path, columns: int = 1) -> Path:
    """Write panels side by side as PNG, SVG or PDF, whole or not at all.

    Raises:
        InputError: UNSUPPORTED for another ending, FILE_UNWRITABLE.
    """
    kind = path.suffix.lower()
    if kind not in _UNDATED:
        raise InputError(ErrorCode.UNSUPPORTED, f"{path}: pictures end in {', '.join(_UNDATED)}")
    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        sheet(panels, columns).savefig(buffer, format=kind[1:], dpi=144, metadata=_UNDATED[kind])
    return write_whole(path, buffer.getvalue())


def add_axes(figure: FigureBase, title: str, below: str = "s", right: float = 0.02, left: float = 0.125) -> Axes:
    """Plain axes with the title at the top left, the unit of x at the bottom right."""
    axes = figure.add_axes((left, 0.15, 1.0 - left - right, 0.70))
    axes.set_gid("plot")
    axes.patch.set_visible(False)
    axes.set_title(title, loc="left", fontsize=11.5, color=PALETTE["ink"], pad=5)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color(PALETTE["measured"])
    axes.tick_params(length=0, labelsize=10.5, labelcolor=PALETTE["muted"])
    axes.grid(axis="y", color=PALETTE["grid"], linewidth=0.8)
    axes.set_axisbelow(True)
    axes.margins(x=0.01)
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    place: Any = {"xycoords": "axes fraction", "xytext": (0, 6), "textcoords": "offset points", "ha": "right"}
    axes.annotate(below, (1, 1), fontsize=10.5, color=PALETTE["muted"], **place)
    return axes


def trace(
    axes: Axes,
    identification: Identification,
    values: Array,
    role: str,
    label: str,
    width: float,
    stamps: NDArray[np.int64] | None = None,
) -> None:
    """Draw one series over seconds since the first wrench sample: marks when sparse, else a thinned line."""
    line(
        axes, _seconds(identification, identification.stamps if stamps is None else stamps), values, role, label, width
    )


def line(axes: Axes, seconds: Array, values: Array, role: str, label: str, width: float, bins: int = BINS) -> None:
    """Draw one series over seconds: marks when sparse, else a line thinned to `bins` stretches."""
    if len(seconds) <= SPARSE:
        size = 5.5 if role == "measured" else 3.2
        axes.plot(seconds, values, "o", color=PALETTE[role], markersize=size, markeredgewidth=0, gid=f"series-{label}")
        return
    seconds, values = envelope(*break_at_gaps(seconds, values), bins)
    axes.plot(seconds, values, color=PALETTE[role], linewidth=width, gid=f"series-{label}", solid_joinstyle="round")


def _seconds(identification: Identification, stamps: NDArray[np.int64]) -> Array:
    """Seconds since the first wrench sample."""
    origin = identification.stamps[0] if len(identification.stamps) else 0
    return np.asarray((stamps - origin) * 1e-9)


def mark_rejected(axes: Axes, identification: Identification) -> None:
    """Shade what the estimate did not use; a single sample still gets a visible width."""
    rejected = identification.estimate.rejected
    stamps = np.array([(interval.start, interval.end) for interval in rejected], dtype=np.int64).reshape(-1, 2)
    shade(axes, _seconds(identification, stamps))


def shade(axes: Axes, spans: Array) -> None:
    """Shade spans (K, 2) of x from top to bottom; the shortest still gets a visible width."""
    left, right = axes.get_xlim()
    top_to_bottom = axes.get_xaxis_transform()
    colours: Any = {"facecolor": PALETTE["rejected"], "alpha": 0.16, "linewidth": 0}
    axes.broken_barh(
        [(start, end - start) for start, end in _merged(spans, least=0.006 * (right - left))],
        (0, 1),
        transform=top_to_bottom,
        **colours,
    )


def _merged(spans: Array, least: float) -> list[tuple[float, float]]:
    """Spans (N, 2) made at least so long, and joined where they then meet: few, however many there were."""
    merged: list[tuple[float, float]] = []
    for start, end in sorted((float(start), max(float(end), float(start) + least)) for start, end in spans):
        if merged and start <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(merged[-1][1], end))
        else:
            merged.append((start, end))
    return merged
