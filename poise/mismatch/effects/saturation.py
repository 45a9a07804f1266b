"""Saturation: the reading stays at a limit although the load increases."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion, lattice, white_level
from poise.types import Array, Mask

_GROUPS = (("force_limit", "N", slice(0, 3)), ("torque_limit", "N m", slice(3, 6)))
_HIGHEST = 1e4
"""N or N m: a limit that is never reached."""
_FEWEST = 8
"""Readings at exactly one extreme value that chance does not explain."""
_BEYOND, _SIGMAS = 0.9, 3.0
"""Share of these readings at which the load reaches the limit as the model predicts it, within so many sigmas."""
_VARIES = 0.5
"""Scatter of the predicted load at equal readings, in units of the noise, from which the load is not at rest."""
_SAME = 0.02
"""Relative difference within which a limit that the readings show is the one that the model states."""


class Saturation(Effect):
    """w_read = clip(w, -limit, limit), the three forces with one limit, the three torques with another.

    The readings show it. A reading at its limit says only that the load is no smaller: see `limited_readings`.
    """

    name = "saturation"
    layer = "sensor"
    fast = True
    direct = True
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
        del residual
        limited = limited_readings(recorded)
        if limited is not None:
            yield _limits(recorded, limited)

    def detected(self, recorded: RecordedMotion) -> Values | None:
        """The limits, where the predicted load exceeds them while the readings stay at them."""
        limited = limited_readings(recorded)
        if limited is None:
            return None
        beyond = recorded.prediction * np.sign(recorded.wrench) - np.abs(recorded.wrench)
        steps = [lattice(recorded.wrench[:, part]) for _, _, part in _GROUPS]
        noise = np.maximum(white_level(recorded.wrench - recorded.prediction).reshape(2, 3).max(axis=1), steps)
        sizes = (beyond / np.repeat(noise, 3))[limited]
        if np.mean(sizes > -_SIGMAS) < _BEYOND or np.mean(sizes) < 1.0:
            return None
        return _limits(recorded, limited)

    def differs(self, values: Values, stated: Values) -> bool:
        return any(values[name] < (1.0 - _SAME) * stated[name] for name, _, _ in _GROUPS)

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        limit = np.repeat([values[name] for name, _, _ in _GROUPS], 3)
        return np.asarray(np.clip(recorded.prediction, -limit, limit) - recorded.prediction)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        del recorded
        stops = [f"{values[name]:.3g} {unit}" for name, unit, _ in _GROUPS if values[name] < 0.99 * _HIGHEST]
        return (
            f"The reading stays at {' and '.join(stops)} although the load increases: the nominal sensor has no limit."
        )


def limited_readings(recorded: RecordedMotion, stated: Values | None = None) -> Mask | None:
    """(N, 6) True where a reading is at the end of the sensor's range; None where no reading is.

    The readings show the range, with one limit for the three forces or torques, or with another one at each end of each
    axis (gauges that limit one axis, a sensor that was tared). A limit that the model states counts too, unless
    readings exceed it.

    Args:
        recorded: the recording.
        stated: the parameters of a limit that the model states, or None.
    """
    at_limit = at_ends(recorded.wrench, recorded.prediction)
    for name, _, part in _GROUPS:
        size = np.abs(recorded.wrench[:, part])
        limits = [plateau(recorded.wrench[:, part]) or _HIGHEST]
        if stated is not None and not exceeded(recorded, name, stated[name]):
            limits.append(stated[name])
        at_limit[:, part] |= size >= min(limits) * (1.0 - 1e-9)
    return at_limit if at_limit.any() else None


def exceeded(recorded: RecordedMotion, name: str, stated: float) -> bool:
    """Whether readings are beyond a limit, `force_limit` or `torque_limit`, that a model states."""
    part = next(part for each, _, part in _GROUPS if each == name)
    return bool(np.nanmax(np.abs(recorded.wrench[:, part])) > (1.0 + _SAME) * stated)


def at_ends(readings: Array, expected: Array) -> Mask:
    """(N, C) readings at an end of the range of one channel, at which the model varies while the reading does not.

    Args:
        readings, expected: (N, C) as measured, and of the model.
    """
    noise = white_level(readings - expected)
    found = np.zeros(readings.shape, dtype=bool)
    for c, channel in enumerate(readings.T):
        for signed in (channel, -channel):
            end = plateau(signed[signed > 0.0])
            if end == 0.0:
                continue
            rows = signed >= end * (1.0 - 1e-9)
            if np.std(expected[rows, c]) > max(_VARIES * noise[c], lattice(channel)):
                found[:, c] |= rows
    return found


def _limits(recorded: RecordedMotion, limited: Mask) -> Values:
    """The limits that limited readings (N, 6) show: the larger one of ends that differ, the highest one without any."""
    size = np.abs(recorded.wrench)
    return {name: float(size[:, part][limited[:, part]].max(initial=0.0)) or _HIGHEST for name, _, part in _GROUPS}


def plateau(values: Array) -> float:
    """The largest magnitude when more readings are at it than chance explains, else 0.

    Readings that are rounded repeat too: far more must be at the limit than at any other value.

    Args:
        values: (N,) or (N, C) of channels with the same limit.
    """
    size = np.abs(values[np.isfinite(values)])
    if not len(size) or size.max() == 0.0:
        return 0.0
    limit = float(size.max())
    at_limit = int((size > limit * (1.0 - 1e-9)).sum())
    if at_limit < _FEWEST:
        return 0.0
    below = size[size <= limit * (1.0 - 1e-9)]
    crowd = int(np.unique(np.round(below / limit, 9), return_counts=True)[1].max()) if len(below) else 0
    return limit if at_limit >= 3 * crowd else 0.0
