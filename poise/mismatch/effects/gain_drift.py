"""Gain drift: the scale of the sensor changes over the recording, as that of strain gauges that warm up."""

from collections.abc import Sequence

from poise.mismatch.effects.base import EffectParameter, Values
from poise.mismatch.effects.drift import Drift
from poise.mismatch.effects.load_changes import imitates_drift
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array


class GainDrift(Drift):
    """w_read = (1 + g (c(t) - c(t0))) w, see `Drift`: the supply and the gauges of all channels warm up together."""

    name = "gain_drift"
    equation = "w_read = (1 + g (c(t) - c(t0))) w, c = (1 - exp(-t / tau)) / (1 - exp(-T / tau))"
    source = "temperature coefficient of gauge factor and modulus (VPG Tech Note TN-504-1); warm-up of first order"
    excited_by = "a load that turns or moves, at the start and at the end"
    confused_with = ("bias_drift", "mass_leak", "sensor_creep", "sensor_gain", "payload_parameters")
    needs = ("load",)
    preferred = False

    def changes(self) -> Sequence[EffectParameter]:
        return [EffectParameter("gain", "", 0.03, low=-0.5, high=0.5)]

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        return self.course(recorded, nonlinear)[:, None, None] * recorded.prediction[:, :, None]

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        refused = super().implausible(recorded, values)
        return refused or imitates_drift(self.course(recorded, values), self.simulate(recorded, values))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        return (
            f"Over the recording the sensor's scale changes by {100 * values['gain']:+.1f} % in all channels: the "
            "nominal model's sensor keeps its scale."
        )
