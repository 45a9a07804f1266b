"""Viscous friction: a joint needs torque in proportion to its speed."""

from poise.mismatch.effects.base import Effect, Parameter, Values
from poise.mismatch.effects.joint_friction import each_joint, efforts, listed, numbers, per
from poise.mismatch.recorded import World
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

    def parameters(self, world: World) -> tuple[Parameter, ...]:
        sizes = per(world, efforts(world).velocity) if world.effort is not None else ()
        return tuple(Parameter(f"damping_{i}", "N m s/rad", s) for i, s in zip(numbers(world), sizes, strict=True))

    def columns(self, world: World, nonlinear: Values) -> Array:
        del nonlinear
        return each_joint(efforts(world).velocity)

    def sentence(self, world: World, values: Values) -> str:
        told = listed(world, [values[f"damping_{i}"] for i in numbers(world)], "N m s/rad")
        return f"Joints need torque in proportion to their speed: {told}; the nominal model has no viscous friction."
