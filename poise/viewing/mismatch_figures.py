"""The figures of a diagnosis: residuals over time, evidence of the hypotheses, autocorrelations."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from poise.mismatch.answer import ResidualWindow, SignalDiagnosis
from poise.mismatch.inference import DependenceCurve, state_description
from poise.types import Array
from poise.viewing.canvas import BINS, PALETTE, Panel, add_axes, line, shade
from poise.viewing.mismatch_summary import ScaledResiduals, correlations, ladder, remaining, residuals

_WIDE = 1110
"""Points: the width of a page."""
_WHOLE = 0.9
"""Share of a recording from which a window is not shaded, as it covers nearly all."""
_TITLES = {"fx": "Force x", "fy": "Force y", "fz": "Force z", "tx": "Torque x", "ty": "Torque y", "tz": "Torque z"}
_LETTER = 6.0
"""Points that a letter of a name takes, about."""


def marked(examination: SignalDiagnosis) -> tuple[ResidualWindow, ...]:
    """The windows to mark: none when nothing was found."""
    return examination.windows if examination.findings or examination.unknown else ()


def _shaded(examination: SignalDiagnosis, left: ScaledResiduals) -> Array:
    """(K, 2) s: windows, except those that cover nearly all of the recording."""
    whole = _WHOLE * float(left.seconds[-1] - left.seconds[0])
    spans = [(window.start, window.end) for window in marked(examination) if window.end - window.start < whole]
    return np.array(spans).reshape(-1, 2)


def timeline_panel(examination: SignalDiagnosis, key: str) -> Panel:
    """Size of the residual before and after, over time, in units of the noise; windows marked, effects named above."""
    left = residuals(examination)
    before, after = left.size(left.before), left.size(left.after)
    bars = [(f.effect.name.replace("_", " "), f.windows) for f in examination.findings if f.windows]
    height = 190 + 18 * len(bars)
    alt = (
        f"Residual over time in units of the noise: up to {before.max():.3g} before and {after.max():.3g} after; "
        f"{len(marked(examination))} windows marked."
    )

    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, "Residual, times the noise", left=0.045, right=0.012)
        axes.set_position((0.045, 28 / height, 0.943, (height - 58 - 18 * len(bars)) / height))
        axes.set_yscale("log")
        axes.axhline(1.0, color=PALETTE["muted"], linewidth=0.8, linestyle=(0, (3, 3)))
        line(axes, left.seconds, before, "measured", "Before", 2.2, 3 * BINS)
        line(axes, left.seconds, after, "accent", "After", 1.3, 3 * BINS)
        top = max(3.0, 1.4 * float(before.max()), 1.4 * float(after.max()))
        axes.set_ylim(0.35, top)
        axes.set_yticks([t for t in (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 5000) if t <= top])
        axes.yaxis.set_major_formatter("{x:g}")
        axes.minorticks_off()
        axes.set_xlim(left.seconds[0], left.seconds[-1])
        shade(axes, _shaded(examination, left))
        _mark_held(axes, left)
        _name_effects(axes, bars, left)

    return Panel(key, alt, draw, (_WIDE, height))


def _mark_held(axes: Axes, left: ScaledResiduals) -> None:
    """A line under the samples that were held out from the fits of the proof."""
    if not left.held.any():
        return
    begin, end = left.seconds[left.held][[0, -1]]
    axes.plot([begin, end], [0.41, 0.41], color=PALETTE["muted"], linewidth=3, solid_capstyle="butt")
    axes.annotate(
        "held out", (end, 0.41), xytext=(0, 3), textcoords="offset points", ha="right", fontsize=10,
        color=PALETTE["muted"],
    )  # fmt: skip


def _name_effects(axes: Axes, bars: list[tuple[str, tuple[tuple[float, float], ...]]], left: ScaledResiduals) -> None:
    """Above the axes, a bar with a name for the windows of each effect."""
    across = axes.get_xaxis_transform()
    points = axes.bbox.height * 72.0 / axes.figure.dpi
    for row, (name, windows) in enumerate(bars):
        height, free = 1.0 + (34 + 18 * row) / points, -np.inf
        span = float(left.seconds[-1] - left.seconds[0])
        room = len(name) * _LETTER / (axes.bbox.width * 72.0 / axes.figure.dpi) * span
        for start, end in windows:
            begin, last = max(start, float(left.seconds[0])), min(end, float(left.seconds[-1]))
            axes.plot(
                [begin, last], [height, height], color=PALETTE["accent"], linewidth=4, transform=across,
                clip_on=False, solid_capstyle="butt",
            )  # fmt: skip
            early = begin < left.seconds[0] + 0.8 * span
            place, side = (begin, "left") if early else (last, "right")
            if (first := place if early else place - room) < free:
                continue  # the bar before it has the same name, which would be printed over
            free = first + room
            axes.annotate(
                name, (place, height), xycoords=across, xytext=(0, 4), textcoords="offset points", ha=side,
                fontsize=10.5, color=PALETTE["ink"], annotation_clip=False,
            )  # fmt: skip


def residual_panels(examination: SignalDiagnosis, key: str) -> list[Panel]:
    """Residual of each channel before and after, with two sigma of the noise on both sides."""
    left = residuals(examination)
    panels = []
    for channel, (name, unit) in enumerate(zip(left.names, left.units, strict=True)):
        before, after, noise = (part[:, channel] for part in (left.before, left.after, left.noise))
        rms = [float(np.sqrt(np.mean(part**2))) for part in (before, after)]
        title = f"{_TITLES.get(name, name)}, {unit}"
        alt = (
            f"Residual of {title}: {rms[0]:.3g} rms before, {rms[1]:.3g} after; "
            f"one sigma of the noise is {float(np.median(noise)):.2g}."
        )

        def draw(
            figure: FigureBase, before: Array = before, after: Array = after, noise: Array = noise, title: str = title
        ) -> None:
            axes = add_axes(figure, title)
            axes.fill_between(left.seconds, -2 * noise, 2 * noise, color=PALETTE["grid"], linewidth=0, zorder=0.5)
            line(axes, left.seconds, before, "measured", "Before", 1.6)
            line(axes, left.seconds, after, "accent", "After", 0.9)
            axes.set_xlim(left.seconds[0], left.seconds[-1])
            shade(axes, _shaded(examination, left))

        panels.append(Panel(f"{key}-{channel}", alt, draw))
    return panels


def ladder_panel(examination: SignalDiagnosis, key: str) -> Panel:
    """Log evidence of the best hypotheses over the nominal model, the answer in colour."""
    rungs = ladder(examination)
    height = 46 + 22 * len(rungs)
    best = max(rungs, key=lambda rung: rung.gain)
    alt = f"Evidence of {len(rungs)} hypotheses: the most, {best.gain:.4g}, for {best.label}."

    def draw(figure: FigureBase) -> None:
        axes = figure.add_axes((0.36, 24 / height, 0.54, (height - 46) / height))
        axes.patch.set_visible(False)
        axes.set_title("log evidence over the nominal model", loc="left", fontsize=11.5, color=PALETTE["ink"], pad=6)
        for side in ("top", "right", "left", "bottom"):
            axes.spines[side].set_visible(False)
        rows = np.arange(len(rungs))[::-1]
        gains = np.array([rung.gain for rung in rungs])
        roles = ["accent" if rung.answer else "measured" for rung in rungs]
        axes.barh(rows, gains, height=0.62, color=[PALETTE[role] for role in roles])
        axes.axvline(0.0, color=PALETTE["muted"], linewidth=0.8)
        axes.set_yticks(rows, [rung.label for rung in rungs])
        axes.set_ylim(-0.6, len(rungs) - 0.4)
        axes.tick_params(length=0, labelsize=10.5, labelcolor=PALETTE["muted"])
        for label, rung in zip(axes.get_yticklabels(), rungs, strict=True):
            label.set_color(PALETTE["ink" if rung.answer else "muted"])
        axes.set_xticks([])
        low, high = min(0.0, float(gains.min())), max(1.0, float(gains.max()))
        axes.set_xlim(max(low, -0.2 * high) - 0.01 * high, 1.1 * high)
        for row, rung in zip(rows, rungs, strict=True):
            axes.annotate(
                f"{rung.gain:.0f}", (max(rung.gain, 0.0), row), xytext=(4, 0), textcoords="offset points",
                va="center", fontsize=10, color=PALETTE["ink" if rung.answer else "muted"],
            )  # fmt: skip

    return Panel(key, alt, draw, (760, height))


def correlation_panels(examination: SignalDiagnosis, key: str) -> list[Panel]:
    """Autocorrelations of the whitened residual at one to twenty samples, with the bound of white noise."""
    white, verdicts = remaining(examination)
    values = correlations(white)
    bound = max(0.1, 3.5 / float(np.sqrt(len(white))))
    left = residuals(examination)
    panels = []
    for channel, (name, verdict) in enumerate(zip(left.names, verdicts, strict=True)):
        alt = f"Autocorrelations of {name}: at most {verdict.strongest_correlation:.2f}; {verdict.verdict}."

        def draw(figure: FigureBase, series: Array = values[:, channel], name: str = name) -> None:
            axes = add_axes(figure, _TITLES.get(name, name), below="samples apart")
            lags = np.arange(1, len(series) + 1)
            axes.axhspan(-bound, bound, color=PALETTE["grid"], linewidth=0, zorder=0.5)
            axes.axhline(0, color=PALETTE["muted"], linewidth=0.8)
            axes.vlines(lags, 0, series, color=PALETTE["accent"], linewidth=2.2)
            reach = max(0.35, 1.15 * float(np.abs(series).max()))
            axes.set_ylim(-reach, reach)
            axes.set_xlim(0, len(series) + 1)

        panels.append(Panel(f"{key}-{channel}", alt, draw, (360, 130)))
    return panels


def shape_panel(shape: DependenceCurve, key: str) -> Panel:
    """The curve of an unknown dependence."""
    what = state_description(shape.state)
    alt = f"The unknown dependence: {shape.channel} over {what}, {np.ptp(shape.response):.3g} {shape.unit} in all."

    def draw(figure: FigureBase) -> None:
        title = f"{_TITLES.get(shape.channel, shape.channel)}, {shape.unit}, over {what}"
        axes = add_axes(figure, title, below="", left=0.08)
        axes.axhline(0, color=PALETTE["muted"], linewidth=0.8)
        axes.plot(shape.values, shape.response, color=PALETTE["accent"], linewidth=1.8, gid="series-Unknown")

    return Panel(key, alt, draw, (560, 210))
