"""Stribeck friction: dry friction that is greater at low speed."""

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
    per,
    reversal,
    reversal_parameters,
    reversals_by_law,
    torque_sizes,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_SLOW = 0.5
"""Share of the largest speed below which stiction acts."""


class StribeckFriction(DryFriction):
    """tau_j = (c_j + s_j exp(-(v_j / v_s)^2)) s(v_j) + d_j v_j; one v_s for all joints.

    s reverses by one of the laws of `reversal`.
    """

    name = "stribeck_friction"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = (torque_j + stiction_j exp(-(v_j / velocity)^2)) tanh(v_j / transition) + damping_j v_j"
    source = "Bo and Pavelescu 1982; Armstrong-Helouvry, Dupont, Canudas de Wit 1994, section 2"
    excited_by = "slow motion and reversals, with many samples at creeping speeds"
    separating_motion = "each joint evenly at 1, 2, 5, 10 and 20 % of its speed: only stiction falls with speed"
    confused_with = ("coulomb_friction", "viscous_friction", "load_dependent_friction", "backlash")
    needs = ("effort",)
    defaults: ClassVar[Values] = {"transition": COULOMB_TRANSITION, **REVERSAL_DEFAULTS}
    of_joint: ClassVar[dict[str, str]] = {"torque": "friction", "damping": "damping"}
    made_of = ("coulomb_friction", "viscous_friction")

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        joints, sizes = numbers(recorded), torque_sizes(recorded)
        rates = per(recorded, "velocity") if recorded.effort is not None else sizes
        made = [EffectParameter("velocity", "rad/s", low=0.02, high=0.6, linear=False, log=True)]
        made += reversal_parameters(recorded)
        friction, damping = in_model(recorded, "friction"), in_model(recorded, "damping")
        kinds = (
            ("torque", "N m", sizes, friction, 0.0),
            ("stiction", "N m", sizes, (0.0,) * len(joints), 0.3),  # it acts where laws of reversals differ most
            ("damping", "N m s/rad", rates, damping, 0.0),
        )
        for kind, unit, scales, known, law_error in kinds:
            made += [
                EffectParameter(f"{kind}_{i}", unit, scale, positive=True, known=there, law_error=law_error)
                for i, scale, there in zip(joints, scales, known, strict=True)
            ]
        return tuple(made)

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        sharp, *_, bent, soft = reversals_by_law(recorded, residual)
        for velocity in (0.05, 0.15):
            for law in (sharp, bent, soft):
                yield {"velocity": velocity, **law}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        velocity, against = efforts(recorded).velocity, reversal(recorded, nonlinear)
        slow = np.exp(-((velocity / nonlinear["velocity"]) ** 2))
        return np.concatenate([each_joint(part) for part in (against, against * slow, velocity)], axis=2)

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        velocity, against = efforts(recorded).velocity, reversal(recorded, values)
        torque, stiction, damping = (of_joints(recorded, values, name) for name in ("torque", "stiction", "damping"))
        slow = np.exp(-((velocity / values["velocity"]) ** 2))
        return np.asarray(against * (torque + stiction * slow) + velocity * damping)

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """Without stiction, this is Coulomb and viscous friction; what falls over the whole range of speeds is none."""
        fastest = float(np.abs(efforts(recorded).velocity).max()) if recorded.effort is not None else np.inf
        if values["velocity"] > _SLOW * fastest:
            return f"stiction would reach up to {values['velocity']:.2f} rad/s of {fastest:.2f} rad/s"
        velocity = self.parameters(recorded)[0]
        if velocity.at_end(values["velocity"]) and values["velocity"] < 2.0 * velocity.low:
            return f"stiction would act below {velocity.low:.2f} rad/s alone, where dry friction reverses"
        stiction, torque = (sum(values[f"{kind}_{i}"] for i in numbers(recorded)) for kind in ("stiction", "torque"))
        torque += sum(in_model(recorded, "friction"))
        return super().implausible(recorded, values) or ("there is no stiction" if stiction < 0.1 * torque else "")

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [values[f"stiction_{i}"] for i in numbers(recorded)], "N m")
        return (
            f"Joints stick: below {values['velocity']:.2f} rad/s their friction is greater, {sizes}; "
            "the nominal model has no stiction."
        )
