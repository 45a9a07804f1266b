"""Effort offset: a joint's torque reading has a constant error."""

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import (
    each_joint,
    efforts,
    like_a_turned_base,
    listed,
    numbers,
    torque_sizes,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array


class EffortOffset(Effect):
    """tau_j = tau_rigid_j + o_j."""

    name = "effort_offset"
    layer = "friction"
    signal = "effort"
    equation = "dtau_j = offset_j"
    source = "Khalil and Dombre 2002, section 12.2 (offset of a joint's torque among the dynamic parameters)"
    excited_by = "any motion; the posture must vary for a joint that bears weight"
    separating_motion = (
        "slow strokes of each joint over its whole range: weight follows the posture, an offset does not"
    )
    confused_with = ("coulomb_friction", "payload_parameters", "link_parameters", "joint_offset", "base_tilt")
    needs = ("effort",)
    widens = "offset"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        sizes = torque_sizes(recorded)
        return tuple(EffectParameter(f"offset_{i}", "N m", s) for i, s in zip(numbers(recorded), sizes, strict=True))

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        return each_joint(np.ones_like(efforts(recorded).velocity))

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sizes = listed(recorded, [values[f"offset_{i}"] for i in numbers(recorded)], "N m")
        said = f"Torque readings of joints have constant errors: {sizes}; the nominal ones have none."
        return said + like_a_turned_base(recorded, np.array([values[f"offset_{i}"] for i in numbers(recorded)]))
