"""Sensor creep: the reading follows a change of load with a delay of seconds."""

from collections.abc import Iterable

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.load_changes import imitates_gain
from poise.mismatch.effects.part_motion import crept
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array


class SensorCreep(Effect):
    """w_read = w + c s, T ds/dt = w - s, s = w at the start: one relaxation, an equal share in all channels."""

    name = "sensor_creep"
    layer = "sensor"
    equation = "w_read = w + c s, T ds/dt = w - s, s(0) = w(0)"
    source = "standard linear solid (Findley, Lai, Onaran 1976, chapter 5); creep of load cells: OIML R 60"
    excited_by = "loads that change and then stay for seconds"
    separating_motion = "turn the tool over quickly and hold still for 30 s: creep grows, a gain acts at once"
    confused_with = ("sensor_gain", "bias_drift", "gain_drift", "sensor_bias", "low_pass", "payload_parameters")
    order = 10
    needs = ("load",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        longest = max(2.0 * recorded.duration, 20.0)
        return (
            EffectParameter("time_constant", "s", low=1.0, high=longest, linear=False, log=True),
            EffectParameter("fraction", "", 0.08, low=-0.5, high=0.5),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del recorded, residual
        for time_constant in (1.5, 3.0, 9.0):
            yield {"time_constant": time_constant}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        return crept(recorded.seconds, recorded.prediction, nonlinear["time_constant"])[:, :, None]

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        refused = super().implausible(recorded, values)
        return refused or imitates_gain(recorded.prediction, self.simulate(recorded, values))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        return (
            f"The sensor creeps: {100 * values['fraction']:+.1f} % of a load comes late, with a time constant of "
            f"{values['time_constant']:.1f} s; the nominal sensor does not creep."
        )
