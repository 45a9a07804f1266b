"""Backlash of a joint whose torque changes its sign elsewhere than the nominal model says."""

import numpy as np
import pytest
from effect_worlds import effort_world, filled

from poise.mismatch.effects import effect_named


@pytest.mark.parametrize("turned", [-0.08, 0.0, 0.12])
def test_the_gap_is_found_where_the_lever_of_the_weight_is_turned(turned: float) -> None:
    """Tolerances of load and encoder turn the lever of a balanced wrist, and with it the moments of all knocks."""
    at, effect = effort_world(), effect_named("backlash")
    given = {"joint": 6.0, "gap": 0.02, "settling": 0.008, "turned": turned, "own": 1.0, "others": 1.0}
    response = effect.simulate(at, filled(effect, at, given))
    level = 0.3 * response[:, 5].std()
    residual = response + level * np.random.default_rng(4).normal(size=response.shape)
    found = next(iter(effect.starts(at, residual)))
    assert found["joint"] == 6.0
    assert found["gap"] == pytest.approx(0.02, rel=0.05)
    assert found["turned"] == pytest.approx(turned, abs=0.02)
