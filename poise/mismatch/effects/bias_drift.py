"""Bias drift: the sensor's zero changes linearly, as during warm-up."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.sensor_bias import BIAS_PARAMETERS
from poise.mismatch.recorded import RecordedMotion, directed
from poise.types import Array


class BiasDrift(Effect):
    """w_read = w + d (t - t0) / T: d is the change over the recording; the offset at t0 belongs to `sensor_bias`.

    At t0 the sensor is within the tolerance of its bias: in the middle of the recording, at its start or at its end.
    """

    name = "bias_drift"
    layer = "sensor"
    equation = "w_read = w + d (t - t0) / T, d in sensor axes: the change over the recording of length T"
    source = "Robotiq FT 300-S manual, section 7 (drift); first order in time"
    excited_by = "time alone"
    separating_motion = "visit the same pose at the start, in the middle and at the end"
    confused_with = ("sensor_bias", "sensor_creep", "mass_leak", "clock_skew")
    widens = "drift"
    defaults: ClassVar[Values] = {"zero": 0.5}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (
            EffectParameter("zero", "", low=0.0, high=1.0, linear=False, choice=True, hidden=True),
            *(
                EffectParameter(axis, unit, size)
                for axis, unit, size in zip(
                    BIAS_PARAMETERS, ["N"] * 3 + ["N m"] * 3, [0.6] * 3 + [0.04] * 3, strict=True
                )
            ),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del recorded, residual
        yield from ({"zero": zero} for zero in (0.5, 0.0, 1.0))

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        passed = (recorded.seconds - recorded.seconds[0]) / recorded.duration
        return np.asarray((passed - nonlinear.get("zero", 0.5))[:, None, None] * np.eye(6))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        change = np.array([values[axis] for axis in BIAS_PARAMETERS])
        return (
            f"Over the recording the sensor's zero drifts by {directed(change[:3].tolist(), 'N')} and "
            f"{np.linalg.norm(change[3:]):.3f} N m: the nominal model's sensor does not drift."
        )
