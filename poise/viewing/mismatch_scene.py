"""The Rerun recording of a diagnosis: residuals before and after, channel by channel, to scrub through in time."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from poise.mismatch.answer import Diagnosis, SignalDiagnosis
from poise.viewing.mismatch_summary import headline, remarks, residuals
from poise.viewing.rerun_file import RerunFile
from poise.viewing.wording import readable

_BEFORE, _AFTER, _NOISE = (163, 171, 182), (64, 128, 240), (120, 130, 140)


def write_mismatch_scene(path: Path, found: Diagnosis) -> Path:
    """Write a Rerun recording (.rrd) with its own layout; open it with `rerun FILE`.

    Entities: `SIGNAL/size/{before,after}` (times the noise), `SIGNAL/CHANNEL/{measured,before,after}` (N, N m),
    `log` with the windows and effects at their start, `answer`. Timelines: `time` since the first wrench sample, and
    `stamp` as recorded.

    Args:
        path: the file, usually ending in .rrd.
        found: what to show.

    Raises:
        InputError: UNSUPPORTED when rerun-sdk is not installed, FILE_UNWRITABLE.
    """
    scene = RerunFile("poise_mismatch", found.main.problem.recorded.start)
    views: dict[str, list[str]] = {}
    for examination in found.examinations:
        views[examination.problem.signal] = _send(scene, examination)
    rows = sorted(_events(found))
    if rows:
        stamps = scene.origin + np.round(np.array([at for at, _ in rows]) * 1e9).astype(np.int64)
        scene.columns("log", stamps, scene.rr.TextLog.columns(text=[text for _, text in rows]))
    sentences = [" – ".join(headline(found)), *(remark.text for remark in remarks(found, ()))]
    scene.static("answer", scene.rr.TextDocument(readable("\n\n".join(sentences), 5000), media_type="text/plain"))
    return scene.write(path, _blueprint(views))


def _send(scene: RerunFile, examination: SignalDiagnosis) -> list[str]:
    """One signal's curves; the paths of its views."""
    signal, left = examination.problem.signal, residuals(examination)
    stamps = scene.origin + np.round(left.seconds * 1e9).astype(np.int64)
    for name, part, colour in (("before", left.before, _BEFORE), ("after", left.after, _AFTER)):
        scene.curve(f"{signal}/size/{name}", stamps, left.size(part), colour, name)
    for channel, name in enumerate(left.names):
        measured = examination.problem.measured[:, channel]
        scene.curve(f"measured/{signal}/{name}", stamps, measured, _NOISE, name)
        for kind, part, colour in (("before", left.before, _BEFORE), ("after", left.after, _AFTER)):
            scene.curve(f"{signal}/{name}/{kind}", stamps, part[:, channel], colour, kind)
    return [f"{signal}/size", *(f"{signal}/{name}" for name in left.names)]


def _events(found: Diagnosis) -> list[tuple[float, str]]:
    """(s, text) of windows and effects."""
    windows = [
        (window.start, f"until {window.end:.2f} s: {window.kind}, {100 * window.share:.0f} % of the excess")
        for each in found.examinations
        for window in each.windows
        if found.verdict != "none"
    ]
    effects = [(start, finding.sentence) for finding in found.findings for start, _ in finding.windows]
    return [*windows, *effects]


def _blueprint(views: dict[str, list[str]]) -> Any:
    import rerun.blueprint as rrb

    def curves(title: str, paths: Sequence[str]) -> Any:
        return rrb.Vertical(*(rrb.TimeSeriesView(origin=f"/{path}", name=path) for path in paths), name=title)

    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.TextDocumentView(origin="/answer", name="Answer"), rrb.TextLogView(origin="/log", name="When")
            ),
            rrb.Tabs(*(curves(signal.capitalize(), paths) for signal, paths in views.items())),
            column_shares=[1, 3],
        ),
        rrb.TimePanel(state="collapsed", timeline="time"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
