"""Sensor gain: scale errors and crosstalk between the axes of the force-torque sensor."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.sensor_bias import BIAS_PARAMETERS
from poise.mismatch.recorded import WRENCH_CHANNELS, RecordedMotion
from poise.types import Array

GAIN_LEVER = 0.1
"""m: a sensor's force range over its torque range (FT 300: 300 N, 30 N m), which scales crosstalk between the two."""

_LARGEST = 0.5
"""Of an axis: a larger scale error is a wrong unit or a broken axis."""
_SHARED = 0.03
"""Gain in the middle of the axes from which the answer says that a payload of another weight acts alike."""
_ACROSS = tuple(f"gain_{read}_{felt}" for read in WRENCH_CHANNELS for felt in WRENCH_CHANNELS if read != felt)


class SensorGain(Effect):
    """w_read = (1 + E) w with a constant 6x6 matrix E: an aged calibration matrix, or that of another sensor.

    Or with a diagonal E: amplifiers that are off, each of its own channel. Crosstalk is then inside its tolerance.
    """

    name = "sensor_gain"
    layer = "sensor"
    equation = "w_read = (1 + E) w; E_ii: scale, E_ij: crosstalk from channel j to channel i"
    source = "Braun and Woernle 2011 (calibration of six-component sensors); the calibration matrix of ATI sensors"
    excited_by = "wrenches in many directions: gravity turning in the sensor, accelerations"
    separating_motion = "six attitudes with and without the payload: a gain scales with the load, a bias does not"
    confused_with = ("payload_parameters", "sensor_rotation", "sensor_nonlinearity")
    needs = ("load",)
    widens = "scale"
    commoner = ("payload_parameters",)
    defaults: ClassVar[Values] = {"axes_alone": 0.0}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        made = [EffectParameter("axes_alone", "", low=0.0, high=1.0, linear=False, choice=True, hidden=True)]
        for i, read in enumerate(WRENCH_CHANNELS):
            for j, felt in enumerate(WRENCH_CHANNELS):
                unit = "" if i // 3 == j // 3 else "m" if i > j else "1/m"
                size = 0.03 if i // 3 == j // 3 else 0.03 * GAIN_LEVER if i > j else 0.03 / GAIN_LEVER
                limit = _LARGEST if i == j else np.inf
                made.append(EffectParameter(f"gain_{read}_{felt}", unit, size, low=-limit, high=limit))
        return tuple(made)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        del recorded, residual
        yield {"axes_alone": 1.0}
        yield {"axes_alone": 0.0}

    def law(self, values: Values) -> str:
        return "axes" if _axes_alone(values) else "matrix"

    def inert(self, values: Values) -> tuple[str, ...]:
        return _ACROSS if _axes_alone(values) else ()

    def exceeds(self, values: Values) -> frozenset[str]:
        return frozenset({self.widens} if _axes_alone(values) else {self.widens, "crosstalk"})

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        out = np.zeros((len(recorded), 6, 36))
        for channel in range(6):
            out[:, channel, 6 * channel : 6 * channel + 6] = recorded.prediction
        return out

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        if _axes_alone(values):
            return {}
        matrix = self._matrix(recorded, values)
        scaled = matrix * np.where(np.arange(6)[:, None] // 3 == np.arange(6) // 3, 1.0, np.nan)
        np.fill_diagonal(scaled, np.nan)
        return {"largest_crosstalk": (float(np.nanmax(np.abs(scaled))), "")}

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        matrix = self._matrix(recorded, values)
        i = int(np.argmax(np.abs(np.diag(matrix))))
        off = f"The sensor's scale is off: {BIAS_PARAMETERS[i]} reads {100 * matrix[i, i]:+.1f} %"
        if _axes_alone(values):
            shared = float(np.median(np.diag(matrix)))
            loads = f" {100 * shared:+.1f} % of all axes may be the payload's." if abs(shared) > _SHARED else ""
            return f"{off}, with crosstalk inside its tolerance: the nominal gain is one.{loads}"
        crosstalk = self.derived(recorded, values)["largest_crosstalk"][0]
        return f"{off}, with crosstalk of up to {100 * crosstalk:.1f} %: the nominal gain is one."

    def _matrix(self, recorded: RecordedMotion, values: Values) -> Array:
        return np.array([values[p.name] for p in self.parameters(recorded) if p.linear]).reshape(6, 6)


def _axes_alone(values: Values) -> bool:
    return values.get("axes_alone", 0.0) > 0.5
