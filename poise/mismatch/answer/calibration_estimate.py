"""Estimates of the calibration errors inside their tolerances, which are no findings."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from poise.mismatch.inference import HypothesisFit, Problem
from poise.mismatch.reading import Tolerance


@dataclass(frozen=True)
class CalibrationEstimate:
    """A calibration error, fitted together with the findings.

    Args:
        group, name: as in `model.yaml` and in the parameters of effects.
        value, std, tolerance: in `unit`; the prior of the fit is centred at zero, as wide as the tolerance.
    """

    group: str
    name: str
    value: float
    std: float
    tolerance: float
    unit: str


def calibration_estimates(problem: Problem, best: HypothesisFit) -> tuple[CalibrationEstimate, ...]:
    """All observable calibration errors of a wrench except gains across axes; none for joint efforts."""
    if problem.signal != "wrench":
        return ()
    groups = problem.groups(problem.compose(best.parts)[1], best.parts)
    shown = [np.abs(group.columns).max(axis=(0, 1)) > 0.0 for group in groups]
    value, spread = best.regression.coefficients(), np.sqrt(np.diag(best.regression.covariance()))
    found, row = [], 0
    for group, seen in zip(groups, shown, strict=True):
        labels = list(_labels(group.name, len(seen), problem.model.tolerance))
        for column in np.flatnonzero(seen):
            if column < len(labels):
                kind, name, size, unit = labels[column]
                found.append(
                    CalibrationEstimate(kind, name, float(value[row] * size), float(spread[row] * size), size, unit)
                )
            row += 1
    return tuple(found)


def _labels(group: str, count: int, at: Tolerance) -> Iterator[tuple[str, str, float, str]]:
    """(group, name, tolerance, unit) of the columns of `calibration`, in their order."""
    if group == "payload":
        yield "payload", "mass", at.payload_mass, ""
        yield from (("payload", f"com_{axis}", at.payload_com, "m") for axis in "xyz")
        parts = ("xx", "xy", "xz", "yy", "yz", "zz")
        yield from (("payload", f"inertia_{part}", at.payload_inertia, "") for part in parts)
    elif group in ("bias", "drift"):
        name = "sensor_bias" if group == "bias" else "bias_drift"
        for what, unit in (("force", "N"), ("torque", "N m")):
            yield from ((name, f"{what}_{axis}", getattr(at, f"{group}_{what}"), unit) for axis in "xyz")
    elif group == "gain":
        yield from (("sensor_gain", f"gain_{what}{axis}", at.sensor_gain, "") for what in "ft" for axis in "xyz")
    elif group == "rotation":
        yield from (("sensor_rotation", f"rotation_{axis}", at.sensor_rotation, "rad") for axis in "xyz")
    elif group == "joints":
        yield from (("joint_offset", f"offset_{k + 1}", at.joint_offset, "rad") for k in range(count))
    elif group == "clock":
        yield "clock_offset", "offset", at.clock_offset, "s"
