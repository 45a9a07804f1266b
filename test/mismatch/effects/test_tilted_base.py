"""An arm that stands tilted on a base that drives."""

from dataclasses import replace

import numpy as np
from effect_worlds import recorded
from scipy.spatial.transform import Rotation

from poise.geometry import STANDARD_GRAVITY
from poise.mismatch.effects import effect_named
from poise.mismatch.recorded import RecordedMotion, load_wrench
from poise.mismatch.recorded.recorded_motion import BaseTrack

TILT = {"rotation_x": 0.05, "rotation_y": -0.08, "on_base": 1.0}


def driven() -> tuple[RecordedMotion, Rotation]:
    """A base that turns and accelerates, and its rotation."""
    at = recorded(duration=6.0)
    still = np.zeros((len(at), 3))
    turns = Rotation.from_rotvec(0.5 * at.seconds[:, None] * [0.0, 0.0, 1.0])
    moved = np.stack([np.sin(at.seconds), 0.3 * np.cos(2.0 * at.seconds), 0.0 * at.seconds], axis=1)
    return replace(at, base=BaseTrack(turns.as_matrix(), still, still, moved, still, still)), turns


def test_gravity_and_the_acceleration_of_the_base_are_felt_tilted() -> None:
    (at, turns), effect = driven(), effect_named("base_tilt")
    assert effect is not None
    assert at.base is not None
    moved = at.base.acceleration_in_world
    tilted = turns * Rotation.from_rotvec([-0.05, 0.08, 0.0]) * turns.inv()
    down = np.array([0.0, 0.0, -STANDARD_GRAVITY])
    specific = at.to_sensor(tilted.apply(down - moved) + moved) - at.linear_acceleration
    exact = load_wrench(at.phi, specific, at.angular_velocity, at.angular_acceleration)
    np.testing.assert_allclose(at.prediction + effect.simulate(at, TILT), exact, atol=1e-9)


def test_the_starts_distinguish_a_tilted_floor_from_a_tilted_mounting() -> None:
    (at, _), effect = driven(), effect_named("base_tilt")
    assert effect is not None
    for on_base in (0.0, 1.0):
        response = effect.simulate(at, {**TILT, "on_base": on_base})
        left = {
            start["on_base"]: np.std(response - effect.simulate(at, start)) for start in effect.starts(at, response)
        }
        assert left[on_base] < 0.3 * left[1.0 - on_base]
