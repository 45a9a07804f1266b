"""Sensor creep: the reading goes on to grow for seconds after a load has come, and stays when it has gone."""

from collections.abc import Iterable

from poise.mismatch.effects.base import Effect, Parameter, Values
from poise.mismatch.effects.part_motion import crept
from poise.mismatch.recorded import World
from poise.types import Array


class SensorCreep(Effect):
    """w_read = w + c s, T ds/dt = w - s, s = w at the start: one relaxation, the same share in all channels."""

    name = "sensor_creep"
    layer = "sensor"
    equation = "w_read = w + c s, T ds/dt = w - s, s(0) = w(0)"
    source = "standard linear solid (Findley, Lai, Onaran 1976, chapter 5); creep of load cells: OIML R 60"
    excited_by = "loads that change and then stay for seconds"
    separating_motion = "turn the tool over quickly and hold still for 30 s: creep grows, a gain is there at once"
    confused_with = ("sensor_gain", "bias_drift", "sensor_bias", "low_pass", "payload_parameters")
    order = 10
    needs = ("load",)

    def parameters(self, world: World) -> tuple[Parameter, ...]:
        longest = max(2.0 * world.duration, 20.0)
        return (
            Parameter("time_constant", "s", low=1.0, high=longest, linear=False, log=True),
            Parameter("fraction", "", 0.08),
        )

    def starts(self, world: World, residual: Array) -> Iterable[Values]:
        del world, residual
        for time_constant in (1.5, 3.0, 9.0):
            yield {"time_constant": time_constant}

    def columns(self, world: World, nonlinear: Values) -> Array:
        return crept(world.seconds, world.prediction, nonlinear["time_constant"])[:, :, None]

    def sentence(self, world: World, values: Values) -> str:
        del world
        return (
            f"The sensor creeps: {100 * values['fraction']:+.1f} % of a load comes late, with a time constant of "
            f"{values['time_constant']:.1f} s; the nominal sensor does not creep."
        )
