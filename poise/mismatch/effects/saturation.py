"""Saturation: the reading stops at a limit while the load goes on."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array, Mask

_GROUPS = (("force_limit", "N", slice(0, 3)), ("torque_limit", "N m", slice(3, 6)))
_HIGHEST = 1e4
"""N or N m: a limit that is never reached."""
_FEWEST = 8
"""Readings at exactly one extreme value that chance does not explain."""


class Saturation(Effect):
    """w_read = clip(w, -limit, limit), the three forces with one limit, the three torques with another."""

    name = "saturation"
    layer = "sensor"
    fast = True
    equation = "w_read = min(max(w, -limit), limit)"
    source = "a converter's or amplifier's range (ATI manual 9620-05-DAQ: saturated gauges)"
    excited_by = "the largest loads"
    separating_motion = "turn slowly through the largest load: the reading stays at exactly one value"
    confused_with = ("sensor_nonlinearity", "sensor_gain")
    order = 90

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return tuple(
            EffectParameter(name, unit, low=1e-3, high=_HIGHEST, linear=False, log=True, resolution=1e-3)
            for name, unit, _ in _GROUPS
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """Readings that stay at one extreme value; without any there is no saturation."""
        del residual
        found = {name: plateau(recorded.wrench[:, part]) or _HIGHEST for name, _, part in _GROUPS}
        if min(found.values()) < _HIGHEST:
            yield found

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        limit = np.repeat([values[name] for name, _, _ in _GROUPS], 3)
        return np.asarray(np.clip(recorded.prediction, -limit, limit) - recorded.prediction)

    @staticmethod
    def passes(recorded: RecordedMotion, values: Values) -> Mask:
        """(N, 6) False where the reading is at its limit and carries no information."""
        limit = np.repeat([values[name] for name, _, _ in _GROUPS], 3)
        return np.asarray(np.abs(recorded.wrench) < limit * (1.0 - 1e-9))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        stops = [f"{values[name]:.3g} {unit}" for name, unit, _ in _GROUPS if values[name] < 0.99 * _HIGHEST]
        return f"The reading stops at {' and '.join(stops)} while the load goes on: the nominal sensor has no limit."


def plateau(values: Array) -> float:
    """The largest magnitude when more readings are at it than chance explains, else 0.

    Readings that are rounded repeat too: there must be far more at the limit than on any step just below it.

    Args:
        values: (N, C) channels with the same limit.
    """
    size = np.abs(values[np.isfinite(values)])
    if not len(size) or size.max() == 0.0:
        return 0.0
    limit = float(size.max())
    at_limit = int((size > limit * (1.0 - 1e-9)).sum())
    below = size[(size > 0.97 * limit) & (size <= limit * (1.0 - 1e-9))]
    crowd = int(np.unique(np.round(below / limit, 9), return_counts=True)[1].max()) if len(below) else 0
    return limit if at_limit >= max(_FEWEST, 3 * crowd) else 0.0
