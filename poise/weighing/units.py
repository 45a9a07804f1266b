"""Readings of the units: a force or a torque in another unit than N and N m."""

import numpy as np

from poise.errors import ErrorCode
from poise.inertia.model import signal_columns
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.fitting import Explanation, ReadingDesign, explain
from poise.weighing.reading import Reading, Repair

_FORCES = {"kgf": 1 / 9.80665, "lbf": 1 / 4.4482216, "kN": 1e-3, "daN": 0.1, "mN": 1e3, "gf": 1e3 / 9.80665}
_TORQUES = {
    "N mm": 1e3,
    "N cm": 1e2,
    "kgf m": 1 / 9.80665,
    "kgf cm": 100 / 9.80665,
    "lbf in": 8.8507457,
    "lbf ft": 0.7375621,
}
"""Numbers that a driver gives for 1 N and 1 N m."""
_COMMON = ("kgf", "N mm", "lbf")
_RARER, _ONE_OF_MANY = -4.0, -2.0


def wrong_units(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """Every unit of force, and of torque, alone."""
    del plain
    ratio = _free_ratio(samples)
    return [_reading(ErrorCode.FORCE_UNIT, name, factor, slice(0, 3), ratio) for name, factor in _FORCES.items()] + [
        _reading(ErrorCode.TORQUE_UNIT, name, factor, slice(3, 6), ratio) for name, factor in _TORQUES.items()
    ]


def _free_ratio(samples: FitSamples) -> tuple[float, float]:
    """Torque per force relative to N m per N, and its standard deviation, from m c in the force and in the torque."""

    def alone(rows: slice) -> Explanation:
        def design(part: FitSamples, values: Array) -> Array:
            columns = signal_columns(part.signals)
            del values
            keep = np.zeros(6)
            keep[rows] = 1.0
            return columns * keep[None, :, None]

        usable = np.zeros(samples.wrench.shape, dtype=bool)
        usable[:, rows] = True
        return explain(samples, design, (), usable)

    force, torque = alone(slice(0, 3)), alone(slice(3, 6))
    a, b = force.phi[1:4], torque.phi[1:4]
    size = float(b @ b)
    if size <= 0 or not np.isfinite(force.covariance[1:4, 1:4]).all():
        return float("nan"), float("nan")
    share = float(a @ b) / size  # torque is the better known one
    spread = float(np.sqrt(b @ force.covariance[1:4, 1:4] @ b)) / size
    return (1 / share, spread / share**2) if share > 3 * spread else (float("nan"), float("nan"))


def _scaled(factor: float, rows: slice) -> ReadingDesign:
    def design(samples: FitSamples, values: Array) -> Array:
        del values
        columns = signal_columns(samples.signals)
        columns[:, rows, :10] *= factor
        return columns

    return design


def _reading(code: ErrorCode, unit: str, factor: float, rows: slice, ratio: tuple[float, float]) -> Reading:
    what, good = ("force", "N") if code is ErrorCode.FORCE_UNIT else ("torque", "N m")
    wrench = np.eye(6)
    wrench[rows, rows] /= factor
    measured = (
        f"; m c in the torque is {ratio[0]:.3g} +- {ratio[1]:.1g} times that in the force"
        if np.isfinite(ratio[0])
        else ""
    )
    sentence = (
        f"the driver's {what} is in {unit}, not in {good}{measured}: set the driver to {good}, or divide its {what} by"
        f" {factor:.6g}"
    )
    evidence = {"factor": factor, "torque_per_force": ratio[0], "torque_per_force_std": ratio[1]}
    return Reading(
        code,
        _scaled(factor, rows),
        lambda found: (sentence, evidence),
        prior=_ONE_OF_MANY if unit in _COMMON else _RARER,
        repair=lambda found: Repair(wrench=wrench),
    )
