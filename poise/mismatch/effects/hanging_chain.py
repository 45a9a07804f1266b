"""Hanging chain: a rope, a hose or a bag hangs from the load and swings."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np
import scipy

from poise.geometry import cross
from poise.mismatch.effects.base import Effect, EffectParameter, Values, values_at
from poise.mismatch.effects.part_wrench import (
    AT_PIVOT,
    PAYLOAD_REACH,
    POINT_PARAMETERS,
    beside_errors,
    beyond_nominal,
    coarsely,
    damping_parameter,
    likely_swings,
    no_part,
    nominal_law,
    nominal_parameter,
    nominal_said,
    nominals,
    place_of,
    specific_at,
    swing_frequency,
)
from poise.mismatch.effects.rope_motion import hanging_rope, rope_modes
from poise.mismatch.effects.starts import noise_in
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_LENGTHS, _STARTS = np.geomspace(0.04, 1.0, 25), 3
"""m: lengths that are tried: steps of 14 %, within the resolution of a swing of _DAMPING; and the best that a search
begins from."""
_DAMPING, _TIP = 0.04, 0.05
_SAMPLES, _FEEBLE = 0.03, 0.05
"""s between the samples of this search, and the share of the residual's square that a pendulum must explain for it."""
_BEGINNINGS, _STEPS, _FOLLOWED = (0.2, 0.4, 0.6, 0.8), 6, 60.0
"""Shares of the recording that are fitted one after another, steps of each fit, and s of a long recording that are."""
_SLOPE, _WIDTH, _INSIDE = 1e-5, 0.01, 1e-3
"""Relative step of a derivative, typical change, and least distance from the ends, of places in the priors."""


class HangingChain(Effect):
    """A rope with a weight at its end hangs from one point of the load, for large swings too.

    It has the mass of its slowest mode as a parameter, and as its length that of the pendulum that swings as slowly:
    for a uniform rope of length L and mass m these are 0.69 m and 0.69 L (4 / j^2, with j the first zero of the Bessel
    function J0). The nominal model has the mass rigid at the pivot, or rigid where it rests, or not at all.
    """

    name = "hanging_chain"
    layer = "load"
    equation = "df = -sum_i m_i x_i'', m_i x_i'' = m_i (g - a_p) + tensions of links of fixed length, from a pivot"
    source = "modes of a hanging chain (D. Bernoulli 1733; Lamb 1923, Higher Mechanics, section 85)"
    excited_by = "starts and stops; level acceleration near the first mode's frequency"
    separating_motion = "a sudden level stop, then rest for ten seconds: a chain swings long, with a fast second mode"
    confused_with = ("slosh", "base_motion", "flexible_mode", "cable", "air_drag")
    needs = ("load",)
    defaults: ClassVar[Values] = {"nominal": AT_PIVOT}
    made_of = ("slosh",)
    lacks = 4.0 / 11.792**2  # the fourth mode of a rope

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (
            EffectParameter("length", "m", low=0.02, high=1.5, linear=False, log=True),
            EffectParameter("tip", "", low=0.0, high=0.5, linear=False, vanishes=True, hidden=True),
            damping_parameter(5e-4, 0.1),
            *(
                EffectParameter(name, "m", low=-PAYLOAD_REACH, high=PAYLOAD_REACH, linear=False)
                for name in POINT_PARAMETERS
            ),
            nominal_parameter(),
            EffectParameter("mass", "kg", 0.3, positive=True),
        )

    def law(self, values: Values) -> str:
        return nominal_law(values)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The lengths whose pendulums fit best, and the rope that follows the residual from its beginning on."""
        swings = [{**each, "tip": _TIP} for each in likely_swings(recorded, residual, _LENGTHS, _DAMPING, _STARTS)]
        yield from ({**each, **self.defaults} for each in swings[1:])
        yield from nominals(swings[0])
        few, left = coarsely(recorded, residual, _SAMPLES)
        weight = 1.0 / noise_in(recorded, residual)
        there = (beside_errors(few, left) * weight).ravel()
        squares = [float(np.sum(self._rest(few, there, weight, values) ** 2)) for values in swings]
        if min(squares) < (1.0 - _FEEBLE) * float(there @ there):
            yield {**self._followed(few, left, weight, swings[int(np.argmin(squares))]), **self.defaults}

    def _followed(self, recorded: RecordedMotion, residual: Array, weight: Array, start: Values) -> dict[str, float]:
        """The values after fits to longer and longer beginnings of a residual.

        A rope that swings far ends elsewhere after a small change of its length: a fit to the whole recording would
        stay at the first length that suits some of its swings.
        """
        moving = [p for p in self.parameters(recorded) if not (p.linear or p.choice or p.name == "tip")]
        values, elapsed = dict(start), recorded.seconds - recorded.seconds[0]
        for share in _BEGINNINGS:
            rows = elapsed <= share * min(float(elapsed[-1]), _FOLLOWED)
            begun = recorded if rows.all() else recorded.select(rows)
            there = (beside_errors(begun, residual[rows]) * weight).ravel()

            def off(
                places: Array, begun: RecordedMotion = begun, there: Array = there, known: Values = values
            ) -> Array:
                return self._rest(begun, there, weight, {**known, **values_at(moving, places)})

            at = np.clip([p.to_unit(values[p.name]) for p in moving], _INSIDE, 1.0 - _INSIDE)
            found = scipy.optimize.least_squares(
                off, at, bounds=(0.0, 1.0), diff_step=_SLOPE, x_scale=_WIDTH, max_nfev=_STEPS
            )
            values = values | values_at(moving, found.x)
        return values

    def _rest(self, recorded: RecordedMotion, there: Array, weight: Array, values: Values) -> Array:
        """What the best mass leaves of a residual (6 N,), which is beside errors and in units of its noise."""
        here = (beside_errors(recorded, self.columns(recorded, values)[:, :, 0]) * weight).ravel()
        return np.asarray(there - max(float(here @ there), 0.0) / max(float(here @ here), 1e-12) * here)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        place, tip = place_of(nonlinear), nonlinear["tip"]
        pull = recorded.to_world(specific_at(recorded, place))
        rate = recorded.to_world(recorded.angular_velocity)
        pulled, twisted = hanging_rope(
            recorded.seconds, pull, rate, nonlinear["length"], tip, nonlinear["damping_ratio"]
        )
        force, twist = recorded.to_sensor(pulled), recorded.to_sensor(twisted)
        swing = np.concatenate([force, cross(place, force) + twist], axis=1)
        modes = rope_modes(tip)
        # Of the pendulum's length, as the centre of the rope is of the rope's.
        depth = nonlinear["length"] * modes.first * (0.5 + 0.5 * tip)
        return (swing + beyond_nominal(recorded, nonlinear, depth))[:, :, None] / modes.share

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        mass = values["mass"] / rope_modes(values["tip"]).share
        frequency = swing_frequency(recorded, values["length"]) / (2.0 * np.pi)
        return {"total_mass": (mass, "kg"), "tip_mass": (values["tip"] * mass, "kg"), "frequency": (frequency, "Hz")}

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        whole = values["mass"] / rope_modes(values["tip"]).share
        return super().implausible(recorded, values) or no_part(recorded, values, whole)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        found = self.derived(recorded, values)
        return (
            f"{1e3 * found['total_mass'][0]:.0f} g of the payload hang, {1e3 * found['tip_mass'][0]:.0f} g of them at "
            f"the end, and swing at {found['frequency'][0]:.2f} Hz, as a rope or a chain does: "
            f"{nominal_said(values)}."
        )
