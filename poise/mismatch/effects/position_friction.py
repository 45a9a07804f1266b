"""Position-dependent friction: a joint's dry friction varies over its revolution."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import EffectParameter, Values
from poise.mismatch.effects.joint_friction import (
    COULOMB_TRANSITION,
    REVERSAL_DEFAULTS,
    DryFriction,
    each_joint,
    efforts,
    listed,
    numbers,
    reversal,
    reversal_parameters,
    reversals_by_law,
    torque_sizes,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_LEAST_TRAVEL = 1.0
"""rad; over a shorter way the variation is nearly constant."""


class PositionFriction(DryFriction):
    """tau_j = (A_j sin q_j + B_j cos q_j) s_j, s as in `reversal`: an eccentric gear, or an uneven bearing."""

    name = "position_friction"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = (sine_j sin q_j + cosine_j cos q_j) s_j (see coulomb_friction)"
    source = "Armstrong 1988 (friction of a joint against its position); Bittencourt and Gunnarsson 2012"
    excited_by = "reversals at many positions of the joint"
    separating_motion = "small strokes at ten places of the joint's range: their friction differs"
    confused_with = ("coulomb_friction", "load_dependent_friction", "gear_ripple")
    needs = ("effort",)
    defaults: ClassVar[Values] = {"transition": COULOMB_TRANSITION, **REVERSAL_DEFAULTS}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        sizes = list(zip(numbers(recorded), torque_sizes(recorded), strict=True))
        waves = (EffectParameter(f"{wave}_{i}", "N m", 0.3 * s, hidden=True) for wave in _WAVES for i, s in sizes)
        return (*reversal_parameters(recorded), *waves)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        yield from reversals_by_law(recorded, residual)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        position, against = efforts(recorded).position, reversal(recorded, nonlinear)
        waves = (wave(position) * against * (np.ptp(position, axis=0) > _LEAST_TRAVEL) for wave in _WAVES.values())
        return np.concatenate([each_joint(part) for part in waves], axis=2)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        return super().derived(recorded, values) | {
            name: (size, "N m") for name, size in _amplitudes(recorded, values).items()
        }

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, list(_amplitudes(recorded, values).values()), "N m")
        return f"The dry friction of joints varies with their position: {sizes}; the nominal model has none."


def _amplitudes(recorded: RecordedMotion, values: Values) -> dict[str, float]:
    """N m, by the name of the amplitude of each joint."""
    return {f"amplitude_{i}": float(np.hypot(values[f"sine_{i}"], values[f"cosine_{i}"])) for i in numbers(recorded)}


_WAVES = {"sine": np.sin, "cosine": np.cos}
