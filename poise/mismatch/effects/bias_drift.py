"""Bias drift: the sensor's zero wanders steadily, as when it warms up."""

import numpy as np

from poise.mismatch.effects.base import Array, Effect, Parameter, Values
from poise.mismatch.effects.sensor_bias import AXES
from poise.mismatch.wording import directed
from poise.mismatch.world import World


class BiasDrift(Effect):
    """w_read = w + r (t - middle): the rate is what counts, the offset is the bias's business."""

    name = "bias_drift"
    layer = "sensor"
    equation = "w_read = w + r (t - t_middle), r constant in sensor axes"
    source = "Robotiq FT 300-S manual, section 7 (drift); first order in time"
    excited_by = "time alone"
    separating_motion = "visit the same pose at the start, in the middle and at the end"
    confused_with = ("sensor_bias", "sensor_creep", "mass_leak", "clock_skew")
    widens = "drift"

    def parameters(self, world: World) -> tuple[Parameter, ...]:
        span = max(world.duration, 1.0)
        return tuple(
            Parameter(f"{axis}_rate", unit, size / span)
            for axis, unit, size in zip(AXES, ["N/s"] * 3 + ["N m/s"] * 3, [1.0] * 3 + [0.08] * 3, strict=True)
        )

    def columns(self, world: World, nonlinear: Values) -> Array:
        del nonlinear
        middle = (world.seconds[0] + world.seconds[-1]) / 2
        return np.asarray((world.seconds - middle)[:, None, None] * np.eye(6))

    def sentence(self, world: World, values: Values) -> str:
        change = np.array([values[f"{axis}_rate"] for axis in AXES]) * world.duration
        return (
            f"Over the recording the sensor's zero drifts by {directed(change[:3].tolist(), 'N')} and "
            f"{np.linalg.norm(change[3:]):.3f} N m: the nominal model's sensor does not drift."
        )
