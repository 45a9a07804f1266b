"""Viscous friction: a joint needs torque in proportion to its speed."""

from typing import ClassVar

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import (
    each_joint,
    efforts,
    in_model,
    lacking,
    listed,
    numbers,
    of_joints,
    per,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array


class ViscousFriction(Effect):
    """tau_j = d_j v_j."""

    name = "viscous_friction"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = damping_j v_j"
    source = "Siciliano et al. 2009, section 7.1; Swevers, Verdonck, De Schutter 2007"
    excited_by = "moving each joint at several speeds"
    separating_motion = "each joint evenly at five speeds both ways: viscous friction is a line through zero"
    confused_with = ("coulomb_friction", "stribeck_friction", "joint_coupling")
    needs = ("effort",)
    of_joint: ClassVar[dict[str, str]] = {"damping": "damping"}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        sizes = per(recorded, "velocity") if recorded.effort is not None else ()
        return tuple(
            EffectParameter(f"damping_{i}", "N m s/rad", s, positive=True, known=known)
            for i, s, known in zip(numbers(recorded), sizes, in_model(recorded, "damping"), strict=True)
        )

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        return each_joint(efforts(recorded).velocity)

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        return efforts(recorded).velocity * of_joints(recorded, values, "damping")

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [values[f"damping_{i}"] for i in numbers(recorded)], "N m s/rad")
        said = f"Joints need torque in proportion to their speed: {sizes}"
        return f"{said}; {lacking(recorded, 'damping', 'viscous friction')}."
