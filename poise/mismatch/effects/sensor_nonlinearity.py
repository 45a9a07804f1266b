"""Sensor nonlinearity: the reading is not proportional to the load."""

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.load_changes import imitates_gain
from poise.mismatch.effects.sensor_bias import BIAS_PARAMETERS
from poise.mismatch.recorded import WRENCH_CHANNELS, RecordedMotion
from poise.types import Array

_TYPICAL = ((0.06, 0.08), (20.0, 2.0))
"""Share of the quadratic and the cubic part in the load, at this force (N) and torque (N m): a small sensor shows as
much at the largest load of the recording."""


class SensorNonlinearity(Effect):
    """w_read_i = w_i + a_i w_i |w_i| + b_i w_i^3, channel by channel: odd, so that push and pull are alike."""

    name = "sensor_nonlinearity"
    layer = "sensor"
    equation = "w_read_i = w_i + a_i w_i |w_i| + b_i w_i^3"
    source = "power series of a load cell's characteristic (ISO 376: interpolation by a cubic)"
    excited_by = "each channel from nothing to its largest load, both ways"
    separating_motion = "six attitudes with a light and with a heavy load: a gain error scales, a nonlinearity grows"
    confused_with = ("sensor_gain", "saturation", "payload_parameters")
    order = 20
    commoner = ("payload_parameters",)
    needs = ("load",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        loads = recorded.once(self.name, lambda: _loads(recorded))
        made = []
        for i, channel in enumerate(WRENCH_CHANNELS):
            load, unit = loads[i // 3], "N" if i < 3 else "(N m)"
            made.append(EffectParameter(f"quadratic_{channel}", f"1/{unit}", _TYPICAL[0][0] / load))
            made.append(EffectParameter(f"cubic_{channel}", f"1/{unit}2", _TYPICAL[0][1] / load**2))
        return tuple(made)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        wrench = recorded.prediction
        out = np.zeros((len(recorded), 6, 12))
        for i in range(6):
            out[:, i, 2 * i] = wrench[:, i] * np.abs(wrench[:, i])
            out[:, i, 2 * i + 1] = wrench[:, i] ** 3
        return out

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        return {"largest_share": (float(np.abs(self._shares(recorded, values)).max()), "")}

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """The reading of a load cell rises with the load, up to the largest load of the recording."""
        load = np.linspace(0.0, 1.0, 11)[:, None] * np.abs(recorded.prediction).max(axis=0)
        quadratic, cubic = (
            np.array([values[f"{kind}_{channel}"] for channel in WRENCH_CHANNELS]) for kind in ("quadratic", "cubic")
        )
        slope = 1.0 + 2.0 * quadratic * load + 3.0 * cubic * load**2
        i = int(np.argmin(slope.min(axis=0)))
        falls = f"the reading of {BIAS_PARAMETERS[i]} would fall with a rising load" if slope.min() <= 0.0 else ""
        refused = super().implausible(recorded, values) or falls
        return refused or imitates_gain(recorded.prediction, self.simulate(recorded, values))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        shares = self._shares(recorded, values)
        i = int(np.argmax(np.abs(shares)))
        return (
            f"The sensor is not linear: at the largest load {BIAS_PARAMETERS[i]} reads {100 * shares[i]:+.1f} % off; "
            "the nominal sensor is linear."
        )

    @staticmethod
    def _shares(recorded: RecordedMotion, values: Values) -> Array:
        """(6,) error over load where each channel is loaded most."""
        largest = np.abs(recorded.prediction).max(axis=0)
        bends = (
            values[f"quadratic_{c}"] * w + values[f"cubic_{c}"] * w**2
            for c, w in zip(WRENCH_CHANNELS, largest, strict=True)
        )
        return np.array(list(bends))


def _loads(recorded: RecordedMotion) -> list[float]:
    """Force and torque, N and N m, at which nonlinearities have their typical shares."""
    largest = np.abs(recorded.nominal).reshape(-1, 2, 3).max(axis=(0, 2), initial=1e-3)
    return list(np.minimum(largest, _TYPICAL[1]).tolist())
