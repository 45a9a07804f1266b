"""Mass leak: the payload loses (or gains) mass at a constant rate, as when grain trickles or a tank drains."""

from collections.abc import Iterable

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
from poise.mismatch.recorded import RecordedMotion, white_level
from poise.types import Array


class MassLeak(Effect):
    """A point mass of the payload becomes lighter at a constant rate from `start` to the end of the recording.

    The leaving mass keeps its momentum; its jet is not modelled (8 g/s at 1 m/s push with 8 mN).
    """

    name = "mass_leak"
    layer = "event"
    equation = "w = w_nominal - rate max(t - start, 0) w_1(p), w_1(p): wrench of 1 kg at p"
    source = "thesis eq. 2.97 with a mass that changes slowly (Meshchersky's equation without the jet)"
    excited_by = "gravity and time"
    separating_motion = "turn the tool over early and late: weight turns with gravity, a drift of the sensor does not"
    confused_with = ("bias_drift", "mass_step", "sensor_creep", "payload_parameters")
    transfers = False

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        first, last = float(recorded.seconds[0]), float(recorded.seconds[-1])
        places = (
            EffectParameter(name, "m", low=-PAYLOAD_REACH, high=PAYLOAD_REACH, linear=False)
            for name in POINT_PARAMETERS
        )
        start = EffectParameter("start", "s", low=first - 0.1 * recorded.duration, high=last, linear=False)
        return (start, *places, EffectParameter("rate", "kg/s", 0.3 / max(recorded.duration, 1.0)))

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The best of several start times, with the place that the moment implies."""
        weight = 1.0 / np.maximum(white_level(residual), 1e-9)
        white = ((residual - residual.mean(axis=0)) * weight).ravel()
        matrix = regressor(recorded.specific, recorded.angular_velocity, recorded.angular_acceleration)[:, :, :4]
        found = []
        for share in np.linspace(0.0, 0.85, 11):
            start = float(recorded.seconds[0] + share * recorded.duration)
            columns = matrix * -np.maximum(recorded.seconds - start, 0.0)[:, None, None]
            columns = (columns - columns.mean(axis=0)) * weight[:, None]
            rate, left = best_fit(columns.reshape(-1, 4), white)
            found.append((left, start, rate))
        _, start, rate = min(found, key=lambda item: item[0])
        far = abs(rate[0]) * PAYLOAD_REACH < np.abs(rate[1:]).max() or rate[0] == 0.0
        place = (
            payload_centre(recorded) if far else np.clip(rate[1:] / rate[0], -0.9 * PAYLOAD_REACH, 0.9 * PAYLOAD_REACH)
        )
        yield {"start": start, **dict(zip(POINT_PARAMETERS, place.tolist(), strict=True))}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        lost = -np.maximum(recorded.seconds - nonlinear["start"], 0.0) * recorded.recording_of(nonlinear["start"])
        return np.asarray((point_wrench(recorded, place_of(nonlinear)) * lost[:, None])[:, :, None])

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        inside = recorded.seconds[recorded.recording_of(values["start"])]
        return ((max(values["start"], float(inside[0])), float(inside[-1])),)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        ((start, end),) = self.windows(recorded, values)
        return {"lost": (values["rate"] * (end - start), "kg")}

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """A payload cannot lose more than it has."""
        lost = self.derived(recorded, values)["lost"][0]
        return f"the payload would lose {lost:.2f} kg" if lost > 1.05 * max(float(recorded.phi[0]), 0.5) else ""

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        ((start, end),) = self.windows(recorded, values)
        verb = "loses" if values["rate"] > 0 else "gains"
        return (
            f"From {start:.1f} s on the payload {verb} {1e3 * abs(values['rate']):.1f} g/s, "
            f"{1e3 * abs(values['rate']) * (end - start):.0f} g by the end: the nominal payload keeps its weight."
        )
