"""Motor gain: a joint's torque constant, or that of its torque sensor, differs from the nominal one."""

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import each_joint, efforts, listed, numbers
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_LOWEST, _HIGHEST = -0.7, 2.0
"""A larger error is another unit or the wrong motor."""

_COMMON = 0.15
"""Largest relative difference of gains that have one cause."""


class MotorGain(Effect):
    """tau_j = (1 + g_j) (tau_rigid_j + tau_stated_j); friction that is found is in units of the motor as it reads.

    tau_stated is the friction, rotor and spring that the nominal model of a simulator states.
    """

    name = "motor_gain"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = gain_j (tau_rigid_j + tau_stated_j)"
    source = "Gautier and Briot 2014 (global identification of the drive gains of robots)"
    excited_by = "gravity in several postures, or a known payload; accelerations"
    separating_motion = "the same slow motion with and without a known payload: the difference is the payload's torque"
    confused_with = ("load_dependent_friction", "payload_parameters", "link_parameters", "motor_inertia")
    needs = ("effort",)
    widens = "gain"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        return tuple(EffectParameter(f"gain_{i}", "", 0.08, low=_LOWEST, high=_HIGHEST) for i in numbers(recorded))

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        track = efforts(recorded)
        return each_joint(track.rigid if track.passive is None else track.rigid + track.passive)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        gains = [values[f"gain_{i}"] for i in numbers(recorded)]
        sizes = listed(recorded, [100.0 * gain for gain in gains], "%")
        said = f"Motors read their torque wrongly: {sizes} beyond the nominal torque constants."
        common = sum(gains) / len(gains)
        if len(gains) < 2 or max(abs(gain - common) for gain in gains) > _COMMON * abs(common):
            return said
        return f"{said} All have about the same factor, {1.0 + common:.2g}: are the masses of the description right?"
