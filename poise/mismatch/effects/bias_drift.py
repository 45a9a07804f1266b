"""Bias drift: the sensor's zero changes evenly, or ever more slowly, as during warm-up."""

from collections.abc import Sequence

import numpy as np

from poise.mismatch.effects.base import EffectParameter, Values
from poise.mismatch.effects.drift import Drift
from poise.mismatch.effects.load_changes import imitates_drift
from poise.mismatch.effects.sensor_bias import BIAS_PARAMETERS
from poise.mismatch.recorded import RecordedMotion, directed
from poise.types import Array

_SIZES = (0.6, 0.6, 0.6, 0.04, 0.04, 0.04)
"""N, N m: typical drifts."""
_PARALLEL = 0.1
"""Sine of the angle between a drift and a load that hardly changes, below which a drifting gain has its response."""


class BiasDrift(Drift):
    """w_read = w + d (c(t) - c(t0)), see `Drift`; the offset at t0 belongs to `sensor_bias`."""

    name = "bias_drift"
    equation = "w_read = w + d (c(t) - c(t0)), c = (1 - exp(-t / tau)) / (1 - exp(-T / tau)), d in sensor axes"
    excited_by = "time alone"
    confused_with = ("sensor_bias", "sensor_creep", "mass_leak", "clock_skew", "gain_drift")
    widens = "drift"

    def changes(self) -> Sequence[EffectParameter]:
        units = ["N"] * 3 + ["N m"] * 3
        return [EffectParameter(*each) for each in zip(BIAS_PARAMETERS, units, _SIZES, strict=True)]

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        return np.asarray(self.course(recorded, nonlinear)[:, None, None] * np.eye(6))

    def twins(self, recorded: RecordedMotion, values: Values) -> tuple[str, ...]:
        course, load = self.course(recorded, values), recorded.prediction
        change, usual = (
            np.asarray(each) / _SIZES for each in ([values[axis] for axis in BIAS_PARAMETERS], load.mean(0))
        )
        across = change - usual * (change @ usual) / max(float(usual @ usual), 1e-300)
        steady = recorded.has("load") and imitates_drift(course, course[:, None] * load)
        return ("gain_drift",) if steady and np.linalg.norm(across) < _PARALLEL * np.linalg.norm(change) else ()

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        change = np.array([values[axis] for axis in BIAS_PARAMETERS])
        return (
            f"Over the recording the sensor's zero drifts by {directed(change[:3].tolist(), 'N')} and "
            f"{np.linalg.norm(change[3:]):.3f} N m: the nominal model's sensor does not drift."
        )
