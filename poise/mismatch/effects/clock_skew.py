"""Clock skew: the wrench's clock runs faster or slower than that of the joints."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import best_fit
from poise.mismatch.recorded import RecordedMotion, at_times
from poise.types import Array

_LARGEST = 0.02


class ClockSkew(Effect):
    """Stamp = true time (1 + skew), both zero at the first sample: w_read(t) = w(t / (1 + skew)), by splines."""

    name = "clock_skew"
    layer = "sensor"
    equation = "w_read(t) = w(t / (1 + skew))"
    source = "affine clock model (IEEE 1588: syntonised clocks); Furgale et al. 2013"
    excited_by = "wrenches that change quickly, early and late in a long recording"
    separating_motion = "the same quick turns at the start and at the end: an offset shifts both alike, a skew does not"
    confused_with = ("clock_offset", "bias_drift", "low_pass")
    order = 50
    late = "late_at_end"
    needs = ("load",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (EffectParameter("skew", "", scale=5e-4, low=-_LARGEST, high=_LARGEST, linear=False, peaked=True),)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """First order about some skews, beside a constant shift; straight lines between samples."""
        weight = np.repeat([1.0, 20.0], 3)
        found = []
        for about in (0.0, -0.003, 0.003, -0.01, 0.01):
            moved = self._shifted(recorded, about)
            late = -np.gradient(moved, recorded.seconds, axis=0) * weight
            columns = np.stack([late * recorded.seconds[:, None], late], axis=2).reshape(-1, 2)
            left = ((residual - moved + recorded.prediction) * weight).ravel()
            step, rest = best_fit(columns, left)
            found.append((rest, about + float(step[0])))
        yield {"skew": float(np.clip(min(found)[1], -0.9 * _LARGEST, 0.9 * _LARGEST))}

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        moved = at_times(recorded.seconds, recorded.prediction, recorded.seconds / (1.0 + values["skew"]))
        return np.asarray(moved - recorded.prediction)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        return {"late_at_end": (values["skew"] * float(recorded.seconds[-1]), "s")}

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        late = values["skew"] * float(recorded.seconds[-1])
        return (
            f"The wrench's clock runs {1e6 * abs(values['skew']):.0f} ppm {'fast' if late > 0 else 'slow'}: "
            f"{1e3 * abs(late):.0f} ms at the end; the nominal model has one clock."
        )

    @staticmethod
    def _shifted(recorded: RecordedMotion, skew: float) -> Array:
        """(N, 6) the reading under a skew, coarsely."""
        taken = recorded.seconds / (1.0 + skew)
        moved = [np.interp(taken, recorded.seconds, channel) for channel in recorded.prediction.T]
        return np.stack(moved, axis=1)
