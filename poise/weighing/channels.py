"""Readings of one channel: it is dead, or its gain or sign is not that of the others."""

from collections.abc import Mapping

import numpy as np

from poise.errors import ErrorCode
from poise.inertia.model import signal_columns
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.fitting import Explanation, ReadingDesign, explain, plain_design
from poise.weighing.reading import Reading, Says, shows_payload

NAMES = tuple(f"{what} {axis}" for what in ("force", "torque") for axis in "xyz")
_DEAD = 0.2
"""Gain below which a channel does not respond to the load."""
_CALIBRATED = 0.05
"""Error of a gain that a calibrated sensor may have."""
_ONE_OF_MANY = -2.0
"""Log prior."""


def wrong_channel(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """The channel whose own gain explains the most."""
    del plain
    fits = [explain(samples, _scaled(axis), (_gain(samples, axis),), quick=True) for axis in range(6)]
    axis = int(np.argmin([fit.levels.sum() for fit in fits]))
    gain = float(fits[axis].values[0])
    return [
        Reading(
            ErrorCode.SENSOR_FAULT if abs(gain) < _DEAD else ErrorCode.POOR_FIT,
            _scaled(axis),
            _sentence(axis),
            starts=((gain,),),
            prior=_ONE_OF_MANY,
            holds=lambda fit: shows_payload(fit) and abs(float(fit.values[0]) - 1.0) > _CALIBRATED,
        )
    ]


def _gain(samples: FitSamples, axis: int) -> float:
    """Of a channel, against the payload that the other five show."""
    usable = np.ones(samples.wrench.shape, dtype=bool)
    usable[:, axis] = False
    load = signal_columns(samples.signals)[:, axis, :10] @ explain(samples, plain_design, (), usable, quick=True).phi
    load = load - load.mean()
    return float(load @ samples.wrench[:, axis] / max(float(load @ load), 1e-12))


def _scaled(axis: int) -> ReadingDesign:
    def design(samples: FitSamples, values: Array) -> Array:
        columns = plain_design(samples, values)
        columns[:, axis, :10] *= values[0]
        return columns

    return design


def _sentence(axis: int) -> Says:
    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        gain, deviation = float(found.values[0]), float(found.value_stds[0])
        reads = f"{NAMES[axis]} reads {gain:.2f} +- {deviation:.1g} times what the other channels imply"
        fix = "its gauge or cable is broken: have the sensor repaired"
        if abs(gain) > _DEAD:
            fix = "check its sign, its unit and the calibration of the sensor"
        return f"{reads}: {fix}", {"channel": float(axis), "gain_of_channel": gain, "gain_of_channel_std": deviation}

    return says
