"""Mass leak: the payload loses (or gains) mass at a constant rate, as when grain trickles or a tank drains."""

import itertools
from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.inertia.model import regressor
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import (
    PAYLOAD_REACH,
    POINT_PARAMETERS,
    best_fit,
    payload_centre,
    place_of,
    point_wrench,
)
from poise.mismatch.effects.starts import noise_in
from poise.mismatch.recorded import RecordedMotion, shown
from poise.types import Array

_LONGER, _SHORTEST = 1.3, 0.05
"""Longest and shortest leak as shares of the recording; the longest one reaches its end from any start."""
_ENDLESS = 1e9
"""s, of a model without a length: to the end of the recording."""
_BRIEFEST = 1.0
"""s of the shortest leak in any case: a faster change is a step."""
_BEFORE = 0.1
"""Share of the recording before its beginning at which a leak may have begun."""
_SEEN, _EARLY = 0.05, 0.15
"""Share of a recording that must show the payload before a leak that ends early, and how early that is."""
_OPEN = 0.03
"""Share of the recording after the end of a start of which the end is searched."""


class MassLeak(Effect):
    """A point mass of the payload becomes lighter at a constant rate from `start` for `length`, or to the end.

    The leaving mass keeps its momentum; its jet is not modelled (8 g/s at 1 m/s push with 8 mN).
    """

    name = "mass_leak"
    layer = "event"
    equation = "w = w_nominal - rate min(max(t - start, 0), length) w_1(p), w_1(p): wrench of 1 kg at p"
    source = "thesis eq. 2.97 with a mass that changes slowly (Meshchersky's equation without the jet)"
    excited_by = "gravity and time"
    separating_motion = "turn the tool over early and late: weight turns with gravity, a drift of the sensor does not"
    confused_with = ("bias_drift", "gain_drift", "mass_step", "sensor_creep", "payload_parameters")
    transfers = False
    defaults: ClassVar[Values] = {"length": _ENDLESS}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        first, last = float(recorded.seconds[0]), float(recorded.seconds[-1])
        places = (
            EffectParameter(name, "m", low=-PAYLOAD_REACH, high=PAYLOAD_REACH, linear=False)
            for name in POINT_PARAMETERS
        )
        whole = recorded.duration
        start = EffectParameter("start", "s", low=first - _BEFORE * whole, high=last, linear=False)
        shortest = max(_SHORTEST * whole, _BRIEFEST)
        longest = max(_LONGER * whole, 2.0 * shortest)
        length = EffectParameter("length", "s", low=shortest, high=longest, linear=False, log=True, hidden=True)
        return (start, length, *places, EffectParameter("rate", "kg/s", 0.3 / max(whole, 1.0)))

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The best of several times, with the place that the moment implies: a leak to the end, and one that ends."""
        weight = 1.0 / noise_in(recorded, residual)
        white = ((residual - residual.mean(axis=0)) * weight).ravel()
        matrix = regressor(recorded.specific, recorded.angular_velocity, recorded.angular_acceleration)[:, :, :4]
        matrix = shown(recorded, matrix)
        begin, whole = float(recorded.seconds[0]), recorded.duration
        times = (begin + whole * np.linspace(0.0, 0.85, 11)).tolist()

        def fitted(start: float, length: float) -> tuple[float, float, float, Array]:
            columns = matrix * -_gone(recorded.seconds, start, length)[:, None, None]
            columns = (columns - columns.mean(axis=0)) * weight[:, None]
            rate, left = best_fit(columns.reshape(-1, 4), white)
            return left, start, length, rate

        def start_of(found: tuple[float, float, float, Array]) -> Values:
            _, start, length, rate = found
            far = abs(rate[0]) * PAYLOAD_REACH < np.abs(rate[1:]).max() or rate[0] == 0.0
            most = 0.9 * PAYLOAD_REACH
            place = payload_centre(recorded) if far else np.clip(rate[1:] / rate[0], -most, most)
            return {"start": start, "length": length, **dict(zip(POINT_PARAMETERS, place.tolist(), strict=True))}

        # From a leak without an end, a fit finds none: its response does not depend on the length.
        last = begin + whole * (1.0 - _OPEN)
        yield start_of(min((fitted(start, last - start) for start in times), key=_left))
        pairs = itertools.combinations((begin + whole * np.linspace(2 * _SEEN, 0.9, 9)).tolist(), 2)
        yield start_of(min((fitted(start, end - start) for start, end in pairs), key=_left))

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        lost = -_gone(recorded.seconds, nonlinear["start"], nonlinear.get("length", _ENDLESS))
        lost = lost * recorded.recording_of(nonlinear["start"])
        return np.asarray((point_wrench(recorded, place_of(nonlinear)) * lost[:, None])[:, :, None])

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        inside = recorded.seconds[recorded.recording_of(values["start"])]
        return ((max(values["start"], float(inside[0])), float(inside[-1])),)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        ((start, end),) = self.windows(recorded, values)
        stop = min(_stop(values), end)
        ended = {"end": (stop, "s")} if stop < end else {}
        return {"lost": (values["rate"] * (stop - start), "kg"), **ended}

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """A payload cannot lose more than it has.

        A leak that ends must also begin in the recording: else it is any change that becomes slower, as warming is.
        """
        lost = self.derived(recorded, values)["lost"][0]
        if lost > 1.05 * max(float(recorded.phi[0]), 0.5):
            return f"the payload would lose {lost:.2f} kg"
        ((start, end),) = self.windows(recorded, values)
        ends = _stop(values) < end - _EARLY * recorded.duration
        begins = start > recorded.seconds[0] + _SEEN * recorded.duration
        return "it would end without a beginning" if ends and not begins else ""

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        ((start, end),) = self.windows(recorded, values)
        verb = "loses" if values["rate"] > 0 else "gains"
        stop, lost = _stop(values), abs(self.derived(recorded, values)["lost"][0])
        until = "on" if stop >= end else f"to {stop:.1f} s"
        return (
            f"From {start:.1f} s {until} the payload {verb} {1e3 * abs(values['rate']):.1f} g/s, "
            f"{1e3 * lost:.0f} g by the end: the nominal payload keeps its weight."
        )


def _stop(values: Values) -> float:
    """s at which it ends, also beyond the recording."""
    return values["start"] + values.get("length", _ENDLESS)


def _gone(seconds: Array, start: float, length: float) -> Array:
    """(N,) s for which it has leaked."""
    return np.clip(seconds - start, 0.0, length)


def _left(fitted: tuple[float, float, float, Array]) -> float:
    return fitted[0]
