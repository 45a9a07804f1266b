"""Coulomb friction: a joint needs a constant torque against its motion, at any speed."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.mismatch.effects.base import EffectParameter, Values
from poise.mismatch.effects.joint_friction import (
    COULOMB_TRANSITION,
    REVERSAL_DEFAULTS,
    DryFriction,
    each_joint,
    in_model,
    lacking,
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


class CoulombFriction(DryFriction):
    """tau_j = c_j s_j + b_j |s_j|, s as in `reversal`: b is the difference between the two directions."""

    name = "coulomb_friction"
    layer = "friction"
    signal = "effort"
    equation = (
        "dtau_j = torque_j s_j + asymmetry_j |s_j|, s_j = tanh(v_j / transition), "
        "or presliding_j ds_j/dq_j = sign(v_j) - s_j"
    )
    source = "Coulomb 1785; Dahl 1976; Armstrong-Helouvry, Dupont, Canudas de Wit 1994, section 2"
    excited_by = "reversals: the torque jumps by twice the friction"
    separating_motion = "each joint evenly at five speeds both ways: Coulomb friction is equal at all of them"
    confused_with = (
        "viscous_friction",
        "stribeck_friction",
        "load_dependent_friction",
        "position_friction",
        "temperature_drift",
        "backlash",
    )
    needs = ("effort",)
    of_joint: ClassVar[dict[str, str]] = {"torque": "friction"}
    defaults: ClassVar[Values] = {"transition": COULOMB_TRANSITION, "asymmetry": 0.0, **REVERSAL_DEFAULTS}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        sizes, joints = torque_sizes(recorded), numbers(recorded)
        return (
            *reversal_parameters(recorded),
            *(
                EffectParameter(f"torque_{i}", "N m", s, positive=True, known=known)
                for i, s, known in zip(joints, sizes, in_model(recorded, "friction"), strict=True)
            ),
            *(
                EffectParameter(f"asymmetry_{i}", "N m", 0.03 * s, hidden=True)
                for i, s in zip(joints, sizes, strict=True)
            ),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        yield from reversals_by_law(recorded, residual)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        against = reversal(recorded, nonlinear)
        return np.concatenate([each_joint(against), each_joint(np.abs(against))], axis=2)

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        against = reversal(recorded, values)
        torque, asymmetry = (of_joints(recorded, values, name) for name in ("torque", "asymmetry"))
        return np.asarray(against * torque + np.abs(against) * asymmetry)

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """Friction acts against the motion in either direction."""
        known = in_model(recorded, "friction")
        for i, size, there in zip(numbers(recorded), torque_sizes(recorded), known, strict=True):
            if abs(values[f"asymmetry_{i}"]) > values[f"torque_{i}"] + there + size:
                return f"the friction of joint {i} would drive it"
        return super().implausible(recorded, values)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [values[f"torque_{i}"] for i in numbers(recorded)], "N m")
        return f"Joints have Coulomb friction: {sizes}; {lacking(recorded, 'friction', 'dry friction')}."
