"""Motor inertia: the rotor behind the gear must be accelerated too."""

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


class MotorInertia(Effect):
    """tau_j = J_j a_j: the rotor's inertia times the square of the gear's ratio, absent from the robot description."""

    name = "motor_inertia"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = inertia_j a_j"
    source = "Siciliano et al. 2009, section 7.1 (reflected rotor inertia); Featherstone 2008, section 9.6"
    excited_by = "quick changes of each joint's speed"
    separating_motion = "shake joint after joint with the arm folded, then stretched: a link's inertia grows"
    confused_with = ("joint_coupling", "viscous_friction")
    needs = ("effort",)
    of_joint: ClassVar[dict[str, str]] = {"inertia": "armature"}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        sizes = per(recorded, "acceleration") if recorded.effort is not None else ()
        return tuple(
            EffectParameter(f"inertia_{i}", "kg m2", s, positive=True, known=known)
            for i, s, known in zip(numbers(recorded), sizes, in_model(recorded, "armature"), strict=True)
        )

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        return each_joint(efforts(recorded).acceleration)

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        return efforts(recorded).acceleration * of_joints(recorded, values, "inertia")

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [values[f"inertia_{i}"] for i in numbers(recorded)], "kg m2")
        return f"Motor rotors add inertia: {sizes}; {lacking(recorded, 'armature', 'inertia of rotors')}."
