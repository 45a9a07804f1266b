"""Slosh: liquid in a round vessel swings as a pendulum."""

from collections.abc import Iterable

import numpy as np

from poise.geometry import cross
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_motion import hanging
from poise.mismatch.effects.part_wrench import (
    PAYLOAD_REACH,
    POINT_PARAMETERS,
    likely_place,
    payload_centre,
    place_of,
    specific_at,
)
from poise.mismatch.recorded import RecordedMotion, white_level
from poise.types import Array


class Slosh(Effect):
    """A mass on a spherical pendulum about a pivot in the tool; the nominal model has it rigid at the pivot.

    With u the unit vector from the pivot to the mass, in world axes, for large swings too. The response is the
    difference to the rigid mass, -m l u'', and the torque of the damper in the pivot.
    """

    name = "slosh"
    layer = "load"
    equation = "u'' = b - (u.b + |u'|^2) u, b = (g - a_p) / l - 2 zeta sqrt(g / l) (u' - omega x u); df = -m l u''"
    source = "pendulum model of sloshing (Ibrahim 2005, Liquid Sloshing Dynamics, chapter 5)"
    excited_by = "starts and stops; level acceleration near the pendulum's frequency"
    separating_motion = (
        "a sudden level stop, then rest, in two attitudes: the swing hangs from the world, not from the tool"
    )
    confused_with = ("flexible_mode", "loose_part", "payload_parameters", "low_pass")
    needs = ("load",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (
            EffectParameter("length", "m", low=0.008, high=0.5, linear=False, log=True),
            EffectParameter("damping_ratio", "", low=0.003, high=0.7, linear=False, log=True),
            *(
                EffectParameter(name, "m", low=-PAYLOAD_REACH, high=PAYLOAD_REACH, linear=False)
                for name in POINT_PARAMETERS
            ),
            EffectParameter("mass", "kg", 0.5, positive=True),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The lengths whose swing fits the residual best, with the pivot that the torque then means."""
        wanted = residual - residual.mean(axis=0)
        weight = 1.0 / np.maximum(white_level(residual), 1e-9)
        place = payload_centre(recorded)
        scores = []
        for length in np.geomspace(0.02, 0.25, 7):
            values = {
                "length": float(length),
                "damping_ratio": 0.05,
                **dict(zip(POINT_PARAMETERS, place.tolist(), strict=True)),
            }
            response = self.columns(recorded, values)[:, :, 0]
            response = response - response.mean(axis=0)
            along, size = (float(np.sum(response * other * weight**2)) for other in (wanted, response))
            scores.append((along**2 / max(size, 1e-12), along / max(size, 1e-12), response, values))
        best = sorted(scores, key=lambda item: -item[0])[:1]
        for _, mass, response, values in best:
            pivot = likely_place(mass * response[:, :3], wanted[:, 3:]) if mass > 0.0 else place
            yield {**values, **dict(zip(POINT_PARAMETERS, pivot.tolist(), strict=True))}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        place, length = place_of(nonlinear), nonlinear["length"]
        pull = recorded.to_world(specific_at(recorded, place)) / length
        rate = recorded.to_world(recorded.angular_velocity)
        frequency = _frequency(recorded, length)
        damping = 2.0 * nonlinear["damping_ratio"] * frequency
        u, du, ddu = hanging(recorded.seconds, pull, rate, frequency, damping)
        force = recorded.to_sensor(-length * ddu)
        # The damper in the pivot turns the vessel the way the pendulum turns.
        twist = recorded.to_sensor(damping * length**2 * cross(u, du - cross(rate, u)))
        return np.concatenate([force, cross(place, force) + twist], axis=1)[:, :, None]

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        frequency = _frequency(recorded, values["length"]) / (2.0 * np.pi)
        return (
            f"{1e3 * values['mass']:.0f} g of the payload slosh at {frequency:.2f} Hz, as a pendulum of "
            f"{1e3 * values['length']:.0f} mm: the nominal payload is rigid."
        )


def _frequency(recorded: RecordedMotion, length: float) -> float:
    """rad/s of small swings."""
    return float(np.sqrt(np.median(np.linalg.norm(recorded.gravity, axis=1)) / length))
