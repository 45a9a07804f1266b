"""Clock offset: the wrench's stamps are late, or early, against those of the joints."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion, at_times, linear_at
from poise.types import Array

_LARGEST = 0.3
"""s that are searched."""
_COARSE = 0.03
"""s between the samples that choose a starting point."""


class ClockOffset(Effect):
    """w_read(t) = w(t - delay); the shift is exact, by splines through the prediction."""

    name = "clock_offset"
    layer = "sensor"
    equation = "w_read(t) = w(t - d)"
    source = "thesis section 3.2 (delay between kinematics and wrench); temporal calibration (Furgale et al. 2013)"
    excited_by = "wrenches that change quickly: starts, stops, turning under load"
    separating_motion = "quick turns both ways: a delay shifts the wrench, a filter also rounds it"
    confused_with = ("low_pass", "joint_offset", "clock_skew")
    needs = ("load",)
    delay = "offset"
    widens = "clock"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (EffectParameter("offset", "s", 0.02, -_LARGEST, _LARGEST, linear=False, peaked=True),)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        weight = np.repeat([1.0, 20.0], 3)
        rows = slice(None, None, max(round(_COARSE / recorded.period), 1))
        seconds, model, left = recorded.seconds[rows], recorded.prediction[rows], residual[rows]
        tried = np.arange(-_LARGEST, _LARGEST + 0.005, 0.01)
        moved = (linear_at(seconds, model, seconds - delay) - model for delay in tried)
        misfit = [float(np.var((left - shift) * weight, axis=0).sum()) for shift in moved]
        yield {"offset": float(np.clip(tried[int(np.argmin(misfit))], -0.99 * _LARGEST, 0.99 * _LARGEST))}

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        moved = at_times(recorded.seconds, recorded.prediction, recorded.seconds - values["offset"])
        return np.asarray(moved - recorded.prediction)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        delay = values["offset"]
        return (
            f"The wrench's stamps are {1e3 * abs(delay):.1f} ms {'late' if delay > 0 else 'early'} "
            "against the joints': the nominal model has one clock."
        )
