"""No fit gives energy to a joint, and no gear has a gap that can be seen."""

import numpy as np
import pytest
from effect_worlds import effort_world

from poise.mismatch.effects import effect_named


@pytest.mark.parametrize(
    "name",
    ["viscous_friction", "coulomb_friction", "stribeck_friction", "load_dependent_friction", "motor_inertia"],
)
def test_friction_and_rotors_are_never_negative(name):
    parameters = effect_named(name).parameters(effort_world())
    own = [p for p in parameters if p.linear and not p.name.startswith("asymmetry")]
    assert len(own) >= len(effort_world().effort.names)
    assert all(p.lower == 0.0 and not p.within(-0.1 * p.scale) for p in own)


def test_backlash_is_a_gap_of_gears_and_no_swing_of_the_arm():
    (gap,) = (p for p in effect_named("backlash").parameters(effort_world()) if p.name == "gap")
    assert gap.high < np.radians(4.0)
