"""Estimates of the calibration errors inside their tolerances, which are no findings."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from poise.mismatch.inference import HypothesisFit, Problem


@dataclass(frozen=True)
class CalibrationEstimate:
    """A calibration error, fitted together with the findings.

    Args:
        group, name: as in `model.yaml` and in the parameters of effects.
        value, std, tolerance: in `unit`; the prior of the fit is uniform between plus and minus the tolerance.
        at_limit: the value is at the end of its tolerance: the true error is there or beyond.
    """

    group: str
    name: str
    value: float
    std: float
    tolerance: float
    unit: str
    at_limit: bool


_LIMIT = 0.999
"""Of the tolerance."""


def calibration_estimates(problem: Problem, best: HypothesisFit) -> tuple[CalibrationEstimate, ...]:
    """All observable calibration errors except gains across axes, and those that another signal's findings exceed."""
    groups = problem.groups(problem.compose(best.parts)[1], best.parts)
    label = _labels if problem.signal == "wrench" else _effort_labels
    value, spread = best.regression.coefficients(), best.regression.spread
    found, row = [], 0
    for group in groups:
        labels = [] if group.name in problem.widened else list(label(group.name, problem))
        for column in np.flatnonzero(group.seen):
            if column < len(labels):
                kind, name, size, unit = labels[column]
                at, std = float(value[row]), float(spread[row])
                limit, at = abs(at) > _LIMIT, float(np.clip(at, -1.0, 1.0))
                found.append(CalibrationEstimate(kind, name, at * size, std * size, size, unit, limit))
            row += 1
    return tuple(found)


def _effort_labels(group: str, problem: Problem) -> Iterator[tuple[str, str, float, str]]:
    """(group, name, tolerance, unit) of the columns of `effort_calibration`, in their order."""
    at, track = problem.model.tolerance, problem.recorded.effort
    if track is None:
        return
    if group == "gain":
        yield from (("motor_gain", f"gain_{name}", at.motor_gain, "") for name in track.names)
    elif group == "offset":
        sizes = (track.sizes * at.effort_offset).tolist()
        pairs = zip(track.names, sizes, strict=True)
        yield from (("effort_offset", f"offset_{name}", s, track.unit("N m", name)) for name, s in pairs)
    elif group == "joints":
        yield from (("joint_offset", f"offset_{n}", at.joint_offset, track.unit("rad", n)) for n in track.names)
    elif group == "links" and track.links is not None:
        yield from (("link_mass", f"mass_{number}", at.link_mass, "") for number in track.links.numbers)
    elif group == "clock":
        yield "clock_offset", "efforts", at.clock_offset, "s"
    elif group in ("payload", "tilt"):
        yield from _labels(group, problem)


def _labels(group: str, problem: Problem) -> Iterator[tuple[str, str, float, str]]:
    """(group, name, tolerance, unit) of the columns of `calibration`, in their order."""
    at, joints = problem.model.tolerance, problem.recorded.joints
    if group == "payload":
        yield "payload", "mass", at.payload_mass, ""
        yield from (("payload", f"com_{axis}", at.payload_com, "m") for axis in "xyz")
        parts = ("xx", "xy", "xz", "yy", "yz", "zz")
        yield from (("payload", f"inertia_{part}", at.payload_inertia, "") for part in parts)
    elif group in ("bias", "drift"):
        name = "sensor_bias" if group == "bias" else "bias_drift"
        for what, unit in (("force", "N"), ("torque", "N m")):
            yield from ((name, f"{what}_{axis}", getattr(at, f"{group}_{what}"), unit) for axis in "xyz")
    elif group == "scale":
        yield from (("sensor_gain", f"gain_{what}{axis}", at.sensor_gain, "") for what in "ft" for axis in "xyz")
    elif group == "rotation":
        yield from (("sensor_rotation", f"rotation_{axis}", at.sensor_rotation, "rad") for axis in "xyz")
    elif group == "tilt":
        yield from (("base_tilt", f"rotation_{axis}", at.base_tilt, "rad") for axis in "xy")
    elif group == "joints" and joints is not None:
        yield from (("joint_offset", f"offset_{k + 1}", at.joint_offset, "rad") for k in range(len(joints.names)))
    elif group == "clock":
        yield "clock_offset", "offset", at.clock_offset, "s"
