"""Coulomb friction: a joint needs a constant torque against its motion, at any speed."""

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import each_joint, listed, numbers, sense, torque_sizes
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array


class CoulombFriction(Effect):
    """tau_j = c_j sign(v_j)."""

    name = "coulomb_friction"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = torque_j sign(v_j), sign(v) = tanh(v / 5 mrad/s)"
    source = "Coulomb 1785; Armstrong-Helouvry, Dupont, Canudas de Wit 1994, section 2"
    excited_by = "reversals: the torque jumps by twice the friction"
    separating_motion = "each joint evenly at five speeds both ways: Coulomb friction is equal at all of them"
    confused_with = ("viscous_friction", "stribeck_friction", "load_dependent_friction", "backlash")
    needs = ("effort",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        sizes = torque_sizes(recorded)
        return tuple(
            EffectParameter(f"torque_{i}", "N m", s, positive=True)
            for i, s in zip(numbers(recorded), sizes, strict=True)
        )

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        return each_joint(sense(recorded))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [values[f"torque_{i}"] for i in numbers(recorded)], "N m")
        return f"Joints have Coulomb friction: {sizes}; the nominal model has no dry friction."
