"""Bias drift: the sensor's zero changes evenly, or ever more slowly, as during warm-up."""

import itertools
from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.sensor_bias import BIAS_PARAMETERS
from poise.mismatch.recorded import RecordedMotion, directed
from poise.types import Array

_FASTEST, _STRAIGHT = 0.05, 5.0
"""Time constants of the drift, relative to the recording: the fastest, and one that is as good as a line."""
_WARMS = 0.3
"""A time constant from which a fit reaches others, relative to the recording."""
_SHOWN = 2.0
"""Time constant below which it is reported, relative to the recording."""
_ENDLESS = 1e9
"""s, of a model without a time constant: a line."""


class BiasDrift(Effect):
    """w_read = w + d (c(t) - c(t0)): d is the change over the recording; the offset at t0 belongs to `sensor_bias`.

    The course c goes from 0 to 1 along a line, or as a body that warms up does, with a time constant. At t0 the sensor
    is within the tolerance of its bias: in the middle of the recording, at its start or at its end.
    """

    name = "bias_drift"
    layer = "sensor"
    equation = "w_read = w + d (c(t) - c(t0)), c = (1 - exp(-t / tau)) / (1 - exp(-T / tau)), d in sensor axes"
    source = "Robotiq FT 300-S manual, section 7 (drift); a body that warms up (first order), or a line"
    excited_by = "time alone"
    separating_motion = "visit the same pose at the start, in the middle and at the end"
    confused_with = ("sensor_bias", "sensor_creep", "mass_leak", "clock_skew")
    widens = "drift"
    defaults: ClassVar[Values] = {"zero": 0.5, "time_constant": _ENDLESS}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        whole = recorded.duration
        return (
            EffectParameter("zero", "", low=0.0, high=1.0, linear=False, choice=True, hidden=True),
            EffectParameter(
                "time_constant",
                "s",
                low=_FASTEST * whole,
                high=_STRAIGHT * whole,
                linear=False,
                log=True,
                hidden=True,
            ),
            *(
                EffectParameter(axis, unit, size)
                for axis, unit, size in zip(
                    BIAS_PARAMETERS, ["N"] * 3 + ["N m"] * 3, [0.6] * 3 + [0.04] * 3, strict=True
                )
            ),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del residual
        for zero, share in itertools.product((0.5, 0.0, 1.0), (_STRAIGHT, _WARMS)):
            yield {"zero": zero, "time_constant": share * recorded.duration}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        passed = recorded.seconds - recorded.seconds[0]
        slowness = nonlinear.get("time_constant", _ENDLESS)
        course = np.expm1(-passed / slowness) / np.expm1(-recorded.duration / slowness)
        return np.asarray((course - nonlinear.get("zero", 0.5))[:, None, None] * np.eye(6))

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        slowness = values.get("time_constant", _ENDLESS)
        return {"time_constant": (slowness, "s")} if slowness < _SHOWN * recorded.duration else {}

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        change = np.array([values[axis] for axis in BIAS_PARAMETERS])
        return (
            f"Over the recording the sensor's zero drifts by {directed(change[:3].tolist(), 'N')} and "
            f"{np.linalg.norm(change[3:]):.3f} N m: the nominal model's sensor does not drift."
        )
