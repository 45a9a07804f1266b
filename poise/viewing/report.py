"""The HTML report of an identification: one file that needs no network, for people who were not there."""

import math
import shlex
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from poise.files import write_whole
from poise.inertia.model import PARAMETER_NAMES
from poise.inertia.pipeline import Identification, InertialEstimate
from poise.viewing import figures
from poise.viewing.page import Finding, drawn, making, origin, render_page
from poise.viewing.summary import (
    ParameterRow,
    Whiteness,
    correlation,
    finite_residual,
    parameter_rows,
    whiteness,
)
from poise.viewing.wording import counted, readable, rounded

_FILE_NAME = "identification.html"
_PHI_NAMES = ("m", "m cx", "m cy", "m cz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
_MAX_INTERVALS = 200
_SIGN = "What the load exerts on the sensor, in the sensor frame; the bias is part of both."


def write_identification_report(
    directory: Path,
    identification: Identification,
    title: str,
    source: str,
    *,
    command: str | None = None,
    now: datetime | None = None,
) -> Path:
    """Write `identification.html`: the answer, its uncertainty, and the evidence for it.

    The file is self-contained, forbids itself the network (Content-Security-Policy), and depends on nothing but the
    arguments: the same arguments give the same bytes.

    Args:
        directory: made when missing.
        identification: what to show.
        title: heading, any text.
        source: the recording's path or name; of a file, the SHA-256 is shown.
        command: how it was made; default: this process's command line.
        now: date shown; default: the current time.

    Returns:
        The file's path.

    Raises:
        InputError: FILE_UNWRITABLE; an earlier report is then as it was.
    """
    command = shlex.join(sys.argv) if command is None else command
    now = datetime.now(UTC) if now is None else now
    page = render_identification(identification, title, _provenance(identification, source, command, now))
    return write_whole(Path(directory) / _FILE_NAME, page.encode("utf-8"))


def render_identification(identification: Identification, title: str, provenance: Sequence[tuple[str, str]]) -> str:
    """The report's HTML, with (name, value) lines of provenance at its end."""
    estimate = identification.estimate
    rows = parameter_rows(identification)
    left_over = finite_residual(identification)
    leftovers = [
        (name, unit, whiteness(left_over[:, channel]))
        for channel, (name, unit) in enumerate(zip(figures.CHANNELS, figures.CHANNEL_UNITS, strict=True))
    ]
    return render_page(
        "identification.html.j2",
        title=title,
        kicker="Payload identification",
        frame_id=readable(estimate.frame_id),
        mass=rows[0],
        com=rows[1:4],
        com_known=not any(row.reason for row in rows[1:4]),
        findings=_findings(identification, rows, [white for _, _, white in leftovers]),
        rows=rows,
        groups={0: ("Mass", 1), 1: ("Centre of mass", 3), 4: ("Inertia", 6)},
        bias=_bias_rows(identification),
        delay=_delay(identification),
        reasons=_reasons(rows),
        sign=_SIGN,
        leftovers=leftovers,
        rejected=_rejected(identification),
        more_rejected=max(0, len(estimate.rejected) - _MAX_INTERVALS),
        phi_names=_PHI_NAMES,
        correlations=_correlation_rows(identification),
        provenance=provenance,
        data=_data(identification),
        data_id="identification",
        **_pictures(identification),
    )


def _pictures(identification: Identification) -> dict[str, list[dict[str, Any]]]:
    """Every figure of the report as (key, svg), by section."""
    sections = {
        "wrench_panels": figures.wrench_panels(identification),
        "residual_panels": figures.residual_panels(identification),
        "convergence_panels": figures.convergence_panels(identification),
        "motion_panels": [figures.sphere_panel(identification), *figures.motion_panels(identification)],
    }
    return {name: drawn(panels) for name, panels in sections.items()}


def _findings(identification: Identification, rows: list[ParameterRow], whites: list[Whiteness]) -> list[Finding]:
    """What a person should know before using the numbers."""
    estimate = identification.estimate
    findings = [Finding("warn", readable(finding.message, 500)) for finding in identification.estimate.findings]
    if any(row.reason for row in rows):
        hidden = ", ".join(row.name for row in rows if row.reason)
        findings.append(Finding("warn", f"This motion does not show everything: {hidden} not identifiable."))
    if estimate.consistent:
        findings.append(Finding("good", "A body with these parameters can exist."))
    else:
        findings.append(
            Finding("warn", "No body can have these parameters (the pseudo-inertia is not positive definite).")
        )
    findings.append(
        Finding(
            "note",
            f"{counted(estimate.n_samples, 'sample')} used, method {readable(estimate.method, 60)}; "
            f"the estimate leaves {estimate.residual_force:.3g} N and "
            f"{estimate.residual_torque:.3g} N m rms unexplained.",
        )
    )
    coloured = sum(white.verdict == "not white" for white in whites)
    if coloured:
        text = f"{coloured} of 6 residuals are not white: something in them is not in the model."
        findings.append(Finding("warn", text + _worth(estimate)))
    elif all(white.verdict == "white" for white in whites):
        findings.append(Finding("good", "The residuals look like noise: the model leaves nothing visible out."))
    dropped = sum(interval.n_samples for interval in estimate.rejected)
    if dropped:
        spans = counted(len(estimate.rejected), "interval")
        findings.append(Finding("note", f"Not used: {counted(dropped, 'sample')} in {spans}."))
    return findings


def _worth(estimate: InertialEstimate) -> str:
    """How many independent samples the used ones count as, when that is fewer."""
    if not estimate.n_effective < 0.9 * estimate.n_samples:
        return ""
    worth = f"{max(1.0, estimate.n_effective):.0f}"
    return f" Neighbours resemble each other, so {estimate.n_samples} samples count as {worth}; the ± already does so."


def _bias_rows(identification: Identification) -> list[ParameterRow]:
    """What the sensor reads with nothing on it, N and N m."""
    bias, variance = identification.estimate.bias, np.diag(identification.estimate.bias_covariance)
    rows = []
    for name, unit, value, spread in zip(figures.CHANNELS, figures.CHANNEL_UNITS, bias, variance, strict=True):
        shown, sigma = rounded(float(value), math.sqrt(spread) if spread >= 0 else math.nan)
        rows.append(ParameterRow(name.lower(), name, unit, shown, sigma, float(value), ""))
    return rows


def _delay(identification: Identification) -> dict[str, str]:
    """Delay in ms; empty when it was not estimated."""
    delay, sigma = identification.estimate.delay, identification.estimate.delay_std
    if not math.isfinite(delay):
        return {"value": "", "sigma": ""}
    shown, spread = rounded(1e3 * delay, 1e3 * sigma)
    return {"value": shown, "sigma": spread}


def _reasons(rows: list[ParameterRow]) -> list[tuple[str, str]]:
    """(names, reason), each reason once."""
    reasons: dict[str, list[str]] = {}
    for row in rows:
        if row.reason:
            reasons.setdefault(row.reason, []).append(row.name)
    return [(", ".join(names), reason) for reason, names in reasons.items()]


def _rejected(identification: Identification) -> list[dict[str, Any]]:
    """Rejected intervals in seconds since the first wrench sample."""
    origin = int(identification.stamps[0]) if len(identification.stamps) else 0
    return [
        {
            "start": (int(interval.start) - origin) * 1e-9,
            "end": (int(interval.end) - origin) * 1e-9,
            "samples": interval.n_samples,
            "reason": readable(interval.reason).replace("_", " "),
        }
        for interval in identification.estimate.rejected[:_MAX_INTERVALS]
    ]


def _correlation_rows(identification: Identification) -> list[tuple[str, list[int | None]]]:
    """(name, percents), None where unknown."""
    matrix = correlation(np.asarray(identification.estimate.covariance))
    return [
        (name, [round(100 * value) if math.isfinite(value) else None for value in row])
        for name, row in zip(_PHI_NAMES, matrix, strict=True)
    ]


def _provenance(identification: Identification, source: str, command: str, now: datetime) -> list[tuple[str, str]]:
    """Where the numbers come from, so that they can be reproduced."""
    lines = origin(source)
    stamps = identification.stamps
    if len(stamps):
        span = (int(stamps[-1]) - int(stamps[0])) * 1e-9
        lines.append(("Stamps", f"{int(stamps[0])} to {int(stamps[-1])} ns ({span:.3f} s, {len(stamps)} samples)"))
    return [
        *lines,
        ("Motion", identification.source),
        ("Sensor frame", identification.estimate.frame_id),
        ("Method", identification.estimate.method),
        ("Condition", f"{identification.estimate.condition_number:.3g}"),
        *making(command, now),
    ]


def _data(identification: Identification) -> dict[str, Any]:
    """The estimate at full precision, in the fields of `poise identify --json`; NaN for what is not known."""
    estimate = identification.estimate
    return {
        "mass": estimate.parameters.mass,
        "com": estimate.parameters.com,
        "inertia": estimate.parameters.inertia_vector,
        "covariance": estimate.covariance,
        "bias": estimate.bias,
        "delay": estimate.delay,
        "method": readable(estimate.method),
        "consistent": bool(estimate.consistent),
        "unidentified": [name for name in PARAMETER_NAMES if name in estimate.unidentified],
        "n_samples": estimate.n_samples,
        "frame_id": readable(estimate.frame_id),
    }
