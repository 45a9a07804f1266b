"""Friction of real drives in joint efforts: it is no delay, and a gain of the motor scales what is stated of it."""

from dataclasses import replace

import numpy as np
import pytest
from effect_worlds import effort_world, filled

from poise.mismatch.effects import bristles_along, effect_named
from poise.mismatch.reading.effort_errors import driver_error


def sharp_friction(distance: float) -> np.ndarray:
    """(M, 6) N m: dry friction that reverses along a path of this length, rad."""
    (bent,) = bristles_along(effort_world().effort, [distance])
    return np.repeat([8.0, 2.0], 3) * bent


@pytest.mark.parametrize("distance", [3e-4, 2e-3])
def test_friction_that_reverses_along_a_path_is_no_delay(distance: float) -> None:
    """All efforts of a healthy arm were left out, as 20 ms late."""
    at = effort_world()
    noise = 0.05 * np.random.default_rng(1).normal(size=at.effort.measured.shape)
    measured = at.effort.rigid + sharp_friction(distance) + noise
    assert driver_error(at, replace(at.effort, measured=measured)) is None
    late = driver_error(at, replace(at.effort, measured=np.roll(measured, 5, axis=0)))
    assert late is not None
    assert late.kind == "effort_late"
    assert late.values == pytest.approx((0.04,), abs=0.011)


def test_a_motor_gain_scales_the_friction_that_the_model_states() -> None:
    """The rest of it was load_dependent_friction (76 %)."""
    at, effect = effort_world(), effect_named("motor_gain")
    passive = sharp_friction(1e-3)
    stated = replace(at, effort=replace(at.effort, prediction=at.effort.rigid + passive, passive=passive))
    gains = filled(effect, stated, {"gain_2": 0.07})
    expected = np.zeros_like(passive)
    expected[:, 1] = 0.07 * stated.effort.prediction[:, 1]
    np.testing.assert_allclose(effect.simulate(stated, gains), expected, atol=1e-12)
    np.testing.assert_allclose(effect.simulate(at, gains)[:, 1], 0.07 * at.effort.rigid[:, 1], atol=1e-12)
