"""The HTML report of a diagnosis: where recording and simulation differ, what is missing, and the proof."""

import math
import shlex
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from poise.files import write_whole
from poise.mismatch.answer import Diagnosis, NamedEffect, SignalDiagnosis
from poise.viewing import effort_figures
from poise.viewing import mismatch_figures as figures
from poise.viewing.mismatch_summary import headline, labelled, remaining, remarks, residuals
from poise.viewing.page import drawn, making, origin, render_page
from poise.viewing.wording import readable, rounded

_FILE_NAME = "mismatch.html"
_SIGNALS = {"wrench": "Wrench", "effort": "Joint efforts"}


def write_mismatch_report(
    directory: Path,
    found: Diagnosis,
    title: str,
    sources: Sequence[str],
    *,
    notes: Sequence[str] = (),
    command: str | None = None,
    now: datetime | None = None,
) -> Path:
    """Write `mismatch.html`: the verdict, residuals over time, the evidence, the held-out proof, the remainder.

    The file is self-contained and loads nothing from the network; equal arguments give equal bytes.

    Args:
        directory: made when missing.
        found: the result of `diagnose`.
        title: heading, any text.
        sources: paths or names of the recordings; of files, the SHA-256 is shown.
        notes: sentences of the reading.
        command: that made it; default: this process's command line.
        now: date shown; default: the current time.

    Returns:
        The file's path.

    Raises:
        InputError: FILE_UNWRITABLE; an earlier report is then unchanged.
    """
    command = shlex.join(sys.argv) if command is None else command
    now = datetime.now(UTC) if now is None else now
    provenance = [entry for source in sources for entry in origin(source)]
    page = render_mismatch(found, title, notes, [*provenance, *_model_lines(found), *making(command, now)])
    return write_whole(Path(directory) / _FILE_NAME, page.encode("utf-8"))


def render_mismatch(found: Diagnosis, title: str, notes: Sequence[str], provenance: Sequence[tuple[str, str]]) -> str:
    """The report's HTML, with (name, value) lines of provenance at its end."""
    verdict, sentence = headline(found)
    return render_page(
        "mismatch.html.j2",
        title=title,
        kicker="Recording against simulation",
        provenance=provenance,
        data=_data(found),
        data_id="mismatch",
        verdict=readable(verdict),
        sentence=readable(sentence, 1000),
        findings=remarks(found, tuple(readable(note, 500) for note in notes)),
        signals=[_signal(each, index) for index, each in enumerate(found.examinations)],
        effects=[_effect(finding) for finding in found.findings],
        unknown=_unknown(found),
        untestable=[(labelled((name,)), why) for name, why in sorted(found.untestable.items())],
    )


def _signal(examination: SignalDiagnosis, index: int) -> dict[str, Any]:
    """Pictures and tables of one signal."""
    key = f"{examination.problem.signal}{index}"
    left = residuals(examination)
    _, whites = remaining(examination)
    nominal, augmented, given = examination.proof.by_channel
    noise = np.median(left.noise, axis=0)
    return {
        "name": _SIGNALS[examination.problem.signal],
        "timeline": drawn([figures.timeline_panel(examination, f"{key}-timeline")]),
        "residuals": drawn(figures.residual_panels(examination, f"{key}-residual")),
        "ladder": drawn([figures.ladder_panel(examination, f"{key}-ladder")]),
        "correlations": drawn(figures.correlation_panels(examination, f"{key}-correlation")),
        "frictions": drawn(effort_figures.friction_panels(examination, f"{key}-friction")),
        "responses": drawn(effort_figures.response_panels(examination, f"{key}-response")),
        "windows": figures.marked(examination),
        "proof": examination.proof,
        "channels": [
            {
                "name": figures._TITLES.get(name, name),
                "unit": unit,
                "given": given[c],
                "nominal": nominal[c],
                "augmented": augmented[c],
                "noise": noise[c],
                "white": whites[c],
            }
            for c, (name, unit) in enumerate(zip(left.names, left.units, strict=True))
        ],
    }


def _effect(finding: NamedEffect) -> dict[str, Any]:
    """One effect in full."""
    rows = [
        (name.replace("_", " "), *rounded(number.value, number.std), number.unit)
        for name, number in finding.parameters.items()
    ]
    return {
        "name": finding.effect.name.replace("_", " "),
        "sentence": finding.sentence,
        "equation": finding.effect.equation,
        "source": finding.effect.source,
        "separating": finding.effect.separating_motion,
        "probability": finding.belief.probability,
        "rows": rows,
        "rivals": [(labelled((name,)), chance) for name, chance in finding.belief.rivals],
        "alike": [labelled((name,)) for name in finding.belief.alike],
    }


def _unknown(found: Diagnosis) -> dict[str, Any] | None:
    if found.unknown is None:
        return None
    shape = found.unknown.shape
    panels = [] if shape is None else [figures.shape_panel(shape, "unknown-shape")]
    return {"sentence": found.unknown.sentence, "pictures": drawn(panels)}


def _model_lines(found: Diagnosis) -> list[tuple[str, str]]:
    """The nominal model of the comparison."""
    problem = found.main.problem
    recorded, model = problem.recorded, problem.model
    held = ", ".join(component.name for component in model.effects) or "none"
    what = "wrenches" if recorded.has("wrench") else "samples of joint efforts"
    span = f"{recorded.duration:.2f} s, {len(recorded)} {what}"
    mass = f"{recorded.phi[0]:.4g} kg" + (" (identified from the recording)" if model.payload_identified else "")
    return [
        ("Recorded", span),
        ("Sensor frame", model.sensor_frame or "not said"),
        ("Payload", mass),
        ("Effects known", held),
        ("Computed in", f"{found.seconds:.1f} s"),
    ]


def _data(found: Diagnosis) -> dict[str, Any]:
    """The answer at full precision, in the fields of `poise mismatch --json`."""
    proof = found.main.proof
    return {
        "verdict": found.verdict,
        "effects": [
            {
                "name": finding.effect.name,
                "probability": finding.belief.probability,
                "parameters": {
                    name: {"value": number.value, "std": number.std, "unit": number.unit}
                    for name, number in finding.parameters.items()
                },
                "windows": finding.windows,
            }
            for finding in found.findings
        ],
        "unknown": None if found.unknown is None else list(found.unknown.depends_on),
        "fit": {
            "noise_floor": proof.floor,
            "holdout": {"nominal": proof.nominal, "augmented": proof.augmented, "as_given": proof.as_given},
        },
        "seconds": found.seconds if math.isfinite(found.seconds) else None,
    }
