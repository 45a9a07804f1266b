"""Low-pass: the sensor's electronics or driver smooths the wrench."""

from collections.abc import Iterable

from poise.mismatch.effects.base import Effect, Parameter, Values
from poise.mismatch.effects.part_motion import crept
from poise.mismatch.recorded import World
from poise.types import Array


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

    def parameters(self, world: World) -> tuple[Parameter, ...]:
        del world
        return (Parameter("time_constant", "s", low=0.002, high=1.0, linear=False, log=True),)

    def starts(self, world: World, residual: Array) -> Iterable[Values]:
        del world, residual
        for time_constant in (0.01, 0.05, 0.25):
            yield {"time_constant": time_constant}

    def simulate(self, world: World, values: Values) -> Array:
        return crept(world.seconds, world.prediction, values["time_constant"]) - world.prediction

    def sentence(self, world: World, values: Values) -> str:
        del world
        return (
            f"The wrench is smoothed with a time constant of {1e3 * values['time_constant']:.1f} ms: "
            "the nominal sensor is immediate."
        )
