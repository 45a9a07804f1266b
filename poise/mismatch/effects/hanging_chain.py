"""Hanging chain: a rope, a hose or a bag hangs from the load and swings in two modes."""

from collections.abc import Iterable

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import (
    PAYLOAD_REACH,
    POINT_PARAMETERS,
    likely_swings,
    no_part,
    place_of,
    swing_frequency,
    swinging_wrench,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_ROPE = 0.19
"""Length of the second mode's pendulum over that of the first, of a uniform rope: (2.405 / 5.520)^2."""
_LENGTHS, _STARTS = np.geomspace(0.04, 1.0, 25), 3
"""m: lengths that are tried: steps of 14 %, within the resolution of a swing of _DAMPING; and the best that a search
begins from."""
_DAMPING = 0.04


class HangingChain(Effect):
    """The first two modes of a chain of links or a rope, each as a spherical pendulum from one point of the load.

    A small swing of a chain is the sum of its modes. A mode acts on the pivot as a pendulum with the mode's frequency
    and participating mass; for a uniform rope of length L and mass m these are lengths 4 L / j_i^2 and masses
    4 m / j_i^2, with j_i the zeros of the Bessel function J0. Two modes have 82 % of the mass of a rope, all of two
    links. The nominal model has the mass rigid at the pivot.
    """

    name = "hanging_chain"
    layer = "load"
    equation = "df = -sum_i m_i l_i u_i'', each u_i a spherical pendulum (see slosh) of length l_i; i = 1, 2"
    source = "modes of a hanging chain (D. Bernoulli 1733; Lamb 1923, Higher Mechanics, section 85)"
    excited_by = "starts and stops; level acceleration near the first mode's frequency"
    separating_motion = "a sudden level stop, then rest for ten seconds: a chain swings long, with a fast second mode"
    confused_with = ("slosh", "base_motion", "flexible_mode", "cable", "air_drag")
    needs = ("load",)
    made_of = ("slosh",)
    lacks = 4.0 / 8.654**2  # the third mode of a rope

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (
            EffectParameter("length", "m", low=0.02, high=1.5, linear=False, log=True),
            EffectParameter("length_ratio", "", low=0.05, high=0.6, linear=False, log=True, hidden=True),
            EffectParameter("damping_ratio", "", low=5e-4, high=0.7, linear=False, log=True),
            *(
                EffectParameter(name, "m", low=-PAYLOAD_REACH, high=PAYLOAD_REACH, linear=False)
                for name in POINT_PARAMETERS
            ),
            EffectParameter("mass", "kg", 0.3, positive=True),
            EffectParameter("second_mass", "kg", 0.1, positive=True),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The lengths of the first mode that fit best, and the second mode of a rope."""
        for values in likely_swings(recorded, residual, _LENGTHS, _DAMPING, _STARTS):
            yield {**values, "length_ratio": _ROPE}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        place, ratio = place_of(nonlinear), nonlinear["damping_ratio"]
        lengths = nonlinear["length"] * np.array([1.0, nonlinear["length_ratio"]])
        return np.stack([swinging_wrench(recorded, place, length, ratio) for length in lengths.tolist()], axis=2)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        lengths = values["length"] * np.array([1.0, values["length_ratio"]])
        first, second = (swing_frequency(recorded, length) / (2.0 * np.pi) for length in lengths.tolist())
        mass = values["mass"] + values["second_mass"]
        return {"total_mass": (mass, "kg"), "frequency": (first, "Hz"), "second_frequency": (second, "Hz")}

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        if values["second_mass"] > values["mass"]:
            return "the second mode would carry more mass than the first"
        whole = values["mass"] + values["second_mass"]
        return super().implausible(recorded, values) or no_part(recorded, values, whole)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        found = self.derived(recorded, values)
        return (
            f"{1e3 * found['total_mass'][0]:.0f} g hang from the load and swing at {found['frequency'][0]:.2f} Hz and "
            f"{found['second_frequency'][0]:.2f} Hz, as a rope or a chain does: the nominal payload is rigid."
        )
