"""The segments of a recording in which the payload changed, as JSON and as a table."""

from typing import Any

import numpy as np
from rich.table import Table

from poise.inertia.pipeline import Identification, PayloadSegment
from poise.viewing import rounded


def segments_json(answer: Identification) -> list[dict[str, Any]]:
    """One entry for each payload: s, kg, m, kg m2, in the sensor frame."""
    return [
        {
            "start": segment.start * 1e-9,
            "end": segment.end * 1e-9,
            "since": segment.since * 1e-9,
            "event": segment.event,
            "log_odds": segment.log_odds,
            "lost": segment.lost,
            "mass": segment.estimate.parameters.mass,
            "mass_std": segment.estimate.mass_std,
            "com": segment.estimate.parameters.com,
            "com_std": segment.estimate.com_std,
            "inertia": segment.estimate.parameters.inertia_vector,
            "inertia_std": segment.estimate.inertia_std,
            "covariance": segment.estimate.covariance,
            "method": segment.estimate.method,
            "n_samples": segment.estimate.n_samples,
            "residual_force": segment.estimate.residual_force,
            "residual_torque": segment.estimate.residual_torque,
        }
        for segment in answer.segments
    ]


def segment_table(answer: Identification) -> Table | None:
    """A row for each payload with the span of its samples; None where the payload stayed the same."""
    if len(answer.segments) < 2:
        return None
    table = Table(title="payloads, seconds since the start", title_justify="left")
    for heading in ("from s", "to s", "event", "mass kg", "centre of mass mm", "residual N"):
        table.add_column(heading, justify="left" if heading == "event" else "right")
    for segment in answer.segments:
        mass, sigma = rounded(segment.estimate.parameters.mass, segment.estimate.mass_std)
        chosen = " (the answer)" if segment.start == answer.estimate.since else ""
        table.add_row(
            f"{(segment.start - answer.segments[0].start) * 1e-9:.2f}",
            f"{(segment.end - answer.segments[0].start) * 1e-9:.2f}",
            f"{segment.event}{chosen}",
            f"{mass} ± {sigma}",
            _centre(segment),
            f"{segment.estimate.residual_force:.3f}",
        )
    return table


def _centre(segment: PayloadSegment) -> str:
    """The centre of mass, where it is known to better than 0.1 m."""
    centre, spread = segment.estimate.parameters.com, segment.estimate.com_std
    shown = [
        rounded(1e3 * value, 1e3 * deviation)[0] if deviation < 0.1 else "-"
        for value, deviation in zip(np.asarray(centre), spread, strict=True)
    ]
    return ", ".join(shown)
