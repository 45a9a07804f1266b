"""Low-pass: the sensor's electronics or driver smooths the wrench."""

from collections.abc import Iterable

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_motion import crept
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_FASTEST = 0.006
"""s: a faster filter is a delay within the usual tolerance of the clocks, and its rounding is that of the splines."""


class LowPass(Effect):
    """T dw_read/dt = w - w_read, discretised exactly for a wrench that is linear between samples."""

    name = "low_pass"
    layer = "sensor"
    equation = "T dw_read/dt = w - w_read"
    source = "first-order filter, exact for a first-order hold (Franklin, Powell, Workman 1998, section 6.3)"
    excited_by = "wrenches that change quickly"
    separating_motion = "quick turns both ways, and steps: a filter rounds corners, a delay keeps them"
    confused_with = ("clock_offset", "joint_offset", "sensor_creep")
    needs = ("load",)
    delay = "time_constant"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (EffectParameter("time_constant", "s", low=_FASTEST, high=1.0, linear=False, log=True),)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del recorded, residual
        for time_constant in (0.01, 0.05, 0.25):
            yield {"time_constant": time_constant}

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        (constant,) = self.parameters(recorded)
        if constant.at_end(values[constant.name]):
            return f"time_constant would be at most {_FASTEST} s, or at least {constant.high:g} s"
        return super().implausible(recorded, values)

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        return crept(recorded.seconds, recorded.prediction, values["time_constant"]) - recorded.prediction

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        return (
            f"The wrench is smoothed with a time constant of {1e3 * values['time_constant']:.1f} ms: "
            "the nominal sensor has no filter."
        )
