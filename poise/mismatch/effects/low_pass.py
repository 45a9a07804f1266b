"""Low-pass: the sensor's electronics or driver smooths the wrench."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_motion import Oscillator, crept
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_FASTEST = 0.006
"""s: a faster filter is a delay within the usual tolerance of the clocks, and its rounding is that of the splines."""


class LowPass(Effect):
    """T dw_read/dt = w - w_read, discretised exactly for a wrench that is linear between samples.

    Or a Butterworth filter of second order, which delays slow wrenches by as much, and hardly rounds them.
    """

    name = "low_pass"
    layer = "sensor"
    equation = "T dw_read/dt = w - w_read; of second order T^2 w_read''/2 + T w_read' = w - w_read"
    source = (
        "first-order and Butterworth filter, exact for a first-order hold (Franklin, Powell, Workman 1998, section 6.3)"
    )
    excited_by = "wrenches that change quickly"
    separating_motion = "quick turns both ways, and steps: a filter rounds corners, a delay keeps them"
    confused_with = ("clock_offset", "joint_offset", "sensor_creep")
    needs = ("load",)
    delay = "time_constant"
    defaults: ClassVar[Values] = {"second_order": 0.0}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (
            EffectParameter("second_order", "", low=0.0, high=1.0, linear=False, choice=True, hidden=True),
            EffectParameter("time_constant", "s", low=_FASTEST, high=1.0, linear=False, log=True),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del recorded, residual
        for second_order in (0.0, 1.0):
            for time_constant in (0.01, 0.05, 0.25):
                yield {"second_order": second_order, "time_constant": time_constant}

    def law(self, values: Values) -> str:
        return "second order" if _second_order(values) else "first order"

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        _, constant = self.parameters(recorded)
        if constant.at_end(values[constant.name]):
            return f"time_constant would be at most {_FASTEST} s, or at least {constant.high:g} s"
        return super().implausible(recorded, values)

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        constant, wrench = values["time_constant"], recorded.prediction
        if not _second_order(values):
            return crept(recorded.seconds, wrench, constant) - wrench
        stiffness = 2.0 / constant**2
        return np.asarray(Oscillator(recorded.seconds, stiffness, 2.0 / constant)(stiffness * wrench)[0] - wrench)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        constant = values["time_constant"]
        kind = (
            f"by a Butterworth filter of second order with a bandwidth of {np.sqrt(0.5) / (np.pi * constant):.3g} Hz"
            if _second_order(values)
            else f"with a time constant of {1e3 * constant:.1f} ms"
        )
        return f"The wrench is smoothed {kind}: the nominal sensor has no filter."


def _second_order(values: Values) -> bool:
    return values.get("second_order", 0.0) > 0.5
