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
    in_model,
    listed,
    numbers,
    of_joints,
    reversal,
    reversal_parameters,
    reversals_by_law,
    torque_sizes,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_LEAST_TRAVEL = 1.0
"""rad; over a shorter way the variation is nearly constant."""
_UNEVEN = 0.1
"""Least amplitude relative to the mean in some joint; gears with less have Coulomb friction."""
_DIP = 0.3
"""Largest negative friction relative to the largest: one wave is a rough form of a tight spot."""


class PositionFriction(DryFriction):
    """tau_j = (c_j + A_j sin q_j + B_j cos q_j) s_j, s as in `reversal`: an eccentric gear, or an uneven bearing.

    It contains the mean of the friction, which is Coulomb's: friction that is negative somewhere would drive the joint.
    """

    name = "position_friction"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = (torque_j + sine_j sin q_j + cosine_j cos q_j) s_j (see coulomb_friction)"
    source = "Armstrong 1988 (friction of a joint against its position); Bittencourt and Gunnarsson 2012"
    excited_by = "reversals at many positions of the joint"
    separating_motion = "small strokes at ten places of the joint's range: their friction differs"
    confused_with = ("coulomb_friction", "load_dependent_friction", "gear_ripple")
    needs = ("effort",)
    defaults: ClassVar[Values] = {"transition": COULOMB_TRANSITION, "torque": 0.0, **REVERSAL_DEFAULTS}
    of_joint: ClassVar[dict[str, str]] = {"torque": "friction"}
    made_of = ("coulomb_friction",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        sizes = list(zip(numbers(recorded), torque_sizes(recorded), strict=True))
        waves = (EffectParameter(f"{wave}_{i}", "N m", 0.3 * s, hidden=True) for wave in _WAVES for i, s in sizes)
        means = zip(sizes, in_model(recorded, "friction"), strict=True)
        return (
            *reversal_parameters(recorded),
            *(EffectParameter(f"torque_{i}", "N m", s, positive=True, known=known) for (i, s), known in means),
            *waves,
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        yield from reversals_by_law(recorded, residual)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        position, against = efforts(recorded).position, reversal(recorded, nonlinear)
        waves = (wave(position) * against * (np.ptp(position, axis=0) > _LEAST_TRAVEL) for wave in _WAVES.values())
        return np.concatenate([each_joint(part) for part in (against, *waves)], axis=2)

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """Friction acts against the motion wherever the joint was; that of an even gear is Coulomb friction."""
        position = efforts(recorded).position
        size = of_joints(recorded, values, "torque") + in_model(recorded, "friction")
        for name, wave in _WAVES.items():
            size = size + of_joints(recorded, values, name) * wave(position)
        least, most = size.min(axis=0), size.max(axis=0)
        for i, low, high in zip(numbers(recorded), least, most, strict=True):
            if low < -_DIP * max(high, 0.0) - 1e-9:
                return f"the friction of joint {i} would drive it at some positions"
        even = bool(np.all(most - least <= _UNEVEN * (most + least)))
        return super().implausible(recorded, values) or ("it hardly varies with the position" if even else "")

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
