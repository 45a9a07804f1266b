"""Readings of the units: a force or a torque in another unit than N and N m."""

import numpy as np

from poise.inertia.model import signal_columns
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.fitting import Explanation, explain
from poise.weighing.fixed_errors import FORCE_UNIT_ERRORS, IMPERIAL_ERRORS, TORQUE_UNIT_ERRORS
from poise.weighing.reading import Reading, fixed_reading


def wrong_units(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """Every unit of force, and of torque, alone; pounds of both."""
    del plain
    ratio, std = _free_ratio(samples)
    known = np.isfinite(ratio)
    measured = f"; m c in the torque is {ratio:.3g} +- {std:.1g} times that in the force" if known else ""
    more = {"torque_per_force": ratio, "torque_per_force_std": std}
    return [
        fixed_reading(error, measured, more) for error in (*FORCE_UNIT_ERRORS, *TORQUE_UNIT_ERRORS, *IMPERIAL_ERRORS)
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
