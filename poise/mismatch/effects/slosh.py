"""Slosh: liquid in a round vessel swings as a pendulum."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import (
    AT_PIVOT,
    PAYLOAD_REACH,
    POINT_PARAMETERS,
    beyond_nominal,
    damping_parameter,
    likely_swings,
    no_part,
    nominal_law,
    nominal_parameter,
    nominal_said,
    nominals,
    place_of,
    swing_frequency,
    swinging_wrench,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_LONGEST = 0.25
"""m: the pendulum of the first mode of a vessel of 0.4 m radius; what hangs longer is a `hanging_chain`."""
_WIDE = 0.12
"""m: the same for a radius of 0.2 m. A longer pendulum in a hand may as well be a rope whose second mode rests."""
_FIRST_MODE, _RADIUS = 0.455, 1.841
"""Mass of the first mode in a deep round vessel, relative to pi times density times radius cubed; its radius in lengths
of the pendulum (Ibrahim 2005, section 1.2.2)."""
_DENSEST, _LONGER = 2000.0, 4.0
"""kg/m3 of a slurry; times that a trough may be longer across the swing than a round vessel of the same frequency."""


class Slosh(Effect):
    """A mass on a spherical pendulum about a pivot in the tool.

    The nominal model has it rigid at the pivot, as static poses show it; or rigid where it rests, as a drawing has it;
    or not at all.

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
    confused_with = ("hanging_chain", "flexible_mode", "loose_part", "payload_parameters", "low_pass")
    needs = ("load",)
    defaults: ClassVar[Values] = {"nominal": AT_PIVOT}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (
            EffectParameter("length", "m", low=0.008, high=_LONGEST, linear=False, log=True, law_error=0.015),
            damping_parameter(0.003, 0.7),
            *(
                EffectParameter(name, "m", low=-PAYLOAD_REACH, high=PAYLOAD_REACH, linear=False)
                for name in POINT_PARAMETERS
            ),
            nominal_parameter(),
            EffectParameter("mass", "kg", 0.5, positive=True),
        )

    def law(self, values: Values) -> str:
        return nominal_law(values)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The length whose swing fits the residual best, with the pivot that the torque then means."""
        (swing,) = likely_swings(recorded, residual, np.geomspace(0.02, 0.25, 7), 0.05, 1)
        yield from nominals(swing)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        swing = swinging_wrench(recorded, place_of(nonlinear), nonlinear["length"], nonlinear["damping_ratio"])
        return (swing + beyond_nominal(recorded, nonlinear, nonlinear["length"]))[:, :, None]

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """A liquid does not swing more slowly than in the widest vessel: what does hangs, as a chain or a rope.

        Nor does much of it swing fast: what does is rigid, a payload that model.yaml lacks.
        """
        length = self.parameters(recorded)[0]
        if values["length"] > 0.5 * _LONGEST and length.at_end(values["length"]):
            return f"it would swing as a pendulum of {1e3 * _LONGEST:.0f} mm or longer, which is a hanging chain's"
        most = _DENSEST * _LONGER * _FIRST_MODE * np.pi * (_RADIUS * values["length"]) ** 3
        if values["mass"] > most:
            return (
                f"{1e3 * values['mass']:.0f} g of liquid do not swing as fast as a pendulum of "
                f"{1e3 * values['length']:.0f} mm"
            )
        return super().implausible(recorded, values) or no_part(recorded, values, values["mass"])

    def twins(self, recorded: RecordedMotion, values: Values) -> tuple[str, ...]:
        del recorded
        return ("hanging_chain",) if values["length"] > _WIDE else ()

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        frequency = swing_frequency(recorded, values["length"]) / (2.0 * np.pi)
        return (
            f"{1e3 * values['mass']:.0f} g of the payload slosh at {frequency:.2f} Hz, as a pendulum of "
            f"{1e3 * values['length']:.0f} mm: {nominal_said(values)}."
        )
