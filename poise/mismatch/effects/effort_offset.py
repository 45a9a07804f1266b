"""Effort offset: a joint's torque reading has a constant error."""

import numpy as np

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import each_joint, efforts, listed, numbers, torque_sizes
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_ALIKE = 0.1
"""Largest relative difference of offsets and of the weight of a turned base, which a slide of any place feels alike."""


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
        angle = _turned_base(recorded, np.array([values[f"offset_{i}"] for i in numbers(recorded)]))
        also = f" They are those of a base that is turned by {angle:.0f} degrees against its description."
        return said + also if angle else said


def _turned_base(recorded: RecordedMotion, offsets: Array) -> float:
    """degrees by which a base is turned whose gravity has the same constant efforts (J,); 0 where none has."""
    by_gravity, gravity = efforts(recorded).by_gravity, float(np.linalg.norm(recorded.gravity[0]))
    if by_gravity is None or np.ptp(by_gravity, axis=0).max() * gravity > _ALIKE * np.abs(offsets).max():
        return 0.0
    mean, down = by_gravity.mean(axis=0), np.array([0.0, 0.0, -gravity])
    change = np.linalg.lstsq(mean, offsets, rcond=1e-3)[0]
    size = float(np.linalg.norm(down + change))
    explained = np.linalg.norm(mean @ change - offsets) < _ALIKE * np.linalg.norm(offsets)
    if not explained or abs(size / gravity - 1.0) > _ALIKE:
        return 0.0
    return float(np.degrees(np.arccos(np.clip((down + change) @ down / (size * gravity), -1.0, 1.0))))
