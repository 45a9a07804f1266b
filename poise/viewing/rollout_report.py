"""The HTML report of free runs: a model before and after, beside the recording."""

import shlex
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import FigureBase

from poise.files import write_whole
from poise.simulation.rollout import FreeRun, share_removed
from poise.types import Array
from poise.viewing.canvas import PALETTE, Panel, add_axes
from poise.viewing.page import Finding, drawn, making, origin, render_page
from poise.viewing.wording import readable

_ROLES = (("rejected", "red"), ("accent", "blue"), ("axis-y", "green"), ("axis-x", "orange"))
"""Colours of the models, in their order."""


def write_rollout_report(
    directory: Path,
    runs: Sequence[FreeRun],
    source: str,
    content: dict[str, Any],
    *,
    command: str | None = None,
    now: datetime | None = None,
) -> Path:
    """Write `rollout.html`; the file is self-contained and loads nothing from the network.

    Args:
        directory: made when missing.
        runs: of one recording, the model before first.
        source: the recording.
        content: the answer as JSON, for the page.
        command: that made it; default: this process's command line.
        now: date shown; default: the current time.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    command = shlex.join(sys.argv) if command is None else command
    names = [run.arm.path.name for run in runs]
    labels = [name if names.count(name) == 1 else str(run.arm.path) for name, run in zip(names, runs, strict=True)]
    verdict, sentence = _headline(runs)
    page = render_page(
        "rollout.html.j2",
        title=f"Free runs of {', '.join(labels)}",
        kicker="Simulation against recording",
        verdict=verdict,
        sentence=readable(sentence, 1000),
        findings=[Finding("note", readable(note, 500)) for run in runs for note in run.arm.notes],
        columns=["window", "what", *(readable(label) for label in labels)],
        rows=rollout_rows(runs),
        length=f"{runs[0].horizons[-1].horizon:g}",
        legend=[(readable(label), role[1]) for label, role in zip(labels, _ROLES, strict=False)],
        panels=drawn(window_panels(runs)),
        provenance=[*origin(source), *(("Model", str(run.arm.path)) for run in runs), *_made(command, now)],
        data=content,
        data_id="rollout",
    )
    return write_whole(Path(directory) / "rollout.html", page.encode("utf-8"))


def rollout_rows(runs: Sequence[FreeRun]) -> list[list[str]]:
    """For each length of the windows: every joint, their mean, and the wrench where it was measured."""
    rows = []
    for each in zip(*(run.horizons for run in runs), strict=True):
        length = f"{each[0].horizon:g} s ({len(each[0].starts)})"
        for j, joint in enumerate(runs[0].arm.joints):
            rows.append([length, joint, *(f"{one.by_joint[j]:.3g}" for one in each)])
        rows.append([length, "all joints", *(f"{one.mean:.3g}" for one in each)])
        for column, what in enumerate(("force", "torque")):
            sizes = [float(np.mean(one.wrench[:, column])) for one in each]
            if np.isfinite(sizes).any():
                rows.append([length, what, *(f"{size:.3g}" for size in sizes)])
        if any(one.diverged for one in each):
            rows.append([length, "windows that diverged", *(str(one.diverged) for one in each)])
    return rows


def window_panels(runs: Sequence[FreeRun]) -> list[Panel]:
    """Each joint in the window, of the longest, in which the first model is off by a middle amount."""
    first = runs[0]
    errors = first.horizons[-1].motion.mean(axis=1)
    window = int(np.argsort(errors)[len(errors) // 2])
    begin = float(first.horizons[-1].starts[window])
    return [
        _panel(joint, begin, first.seconds, first.recorded[window, :, j], [run.position[window, :, j] for run in runs])
        for j, joint in enumerate(first.arm.joints)
    ]


def _panel(joint: str, begin: float, seconds: Array, recorded: Array, simulated: Sequence[Array]) -> Panel:
    off = [float(np.sqrt(np.nanmean((each - recorded) ** 2))) for each in simulated]
    alt = f"{joint} from {begin:.1f} s: off by {', '.join(f'{each:.3g}' for each in off)} (rms)."
    spread = float(np.ptp(recorded))
    low, high = float(recorded.min()) - 0.6 * spread - 1e-3, float(recorded.max()) + 0.6 * spread + 1e-3

    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, f"{joint}, rad or m")
        axes.plot(begin + seconds, recorded, color=PALETTE["measured"], linewidth=3.0)
        for values, (role, _) in zip(simulated, _ROLES, strict=False):
            axes.plot(begin + seconds, values, color=PALETTE[role], linewidth=1.3)
        shown = np.concatenate([recorded, *simulated])
        axes.set_ylim(max(low, float(np.nanmin(shown)) - 1e-3), min(high, float(np.nanmax(shown)) + 1e-3))

    return Panel(f"window-{joint}", alt, draw)


def _headline(runs: Sequence[FreeRun]) -> tuple[str, str]:
    if len(runs) == 1:
        sizes = ", ".join(f"{one.mean:.3g} over {one.horizon:g} s" for one in runs[0].horizons)
        return "Free run", f"Error of the motion, rms, mean over joints: {sizes}."
    removed = share_removed(runs[0].horizons, runs[-1].horizons)
    sizes = ", ".join(f"{100 * share:.0f} % over {horizon:g} s" for horizon, share in removed.items())
    better = all(share > 0.0 for share in removed.values())
    return ("Closer" if better else "Not closer everywhere"), f"Of the error of the motion, this much is gone: {sizes}."


def _made(command: str, now: datetime | None) -> list[tuple[str, str]]:
    return making(command, now or datetime.now(UTC))
