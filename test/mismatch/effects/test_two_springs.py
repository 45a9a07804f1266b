"""A beam that bends in two directions is two flexible modes."""

from dataclasses import replace

import numpy as np
import pytest
from effect_worlds import NOISE, PLACE, recorded

from poise.mismatch.effects import effect_named
from poise.mismatch.effects.part_wrench import chart
from poise.mismatch.inference import names, search, wrench_problem
from poise.mismatch.reading import NominalModel

SPRING = effect_named("flexible_mode")


def test_two_springs_are_found_one_after_the_other():
    at = recorded("poses")
    beam = [
        {"frequency": f, "damping_ratio": 0.04, **chart(axis), **PLACE, "mass": m}
        for f, axis, m in ((3.1, [1.0, 0.2, 0.1], 0.5), (6.4, [-0.1, 1.0, 0.0], 0.6))
    ]
    noise = np.random.default_rng(8).normal(size=at.wrench.shape) * NOISE
    reading = at.prediction + sum(SPRING.simulate(at, values) for values in beam) + noise
    problem = wrench_problem(replace(at, wrench=reading), NominalModel(phi=at.phi))
    _, best = search(problem, [SPRING, effect_named("slosh")])
    assert names(best) == ("flexible_mode", "flexible_mode")
    found = sorted(part.values["frequency"] for part in best.parts)
    assert found == pytest.approx([3.1, 6.4], rel=0.02)


def test_what_moves_with_most_of_the_payload_is_as_likely_a_grasp_that_gives():
    """A hinge at the grip was `flexible_mode` (99.5 %): its mode has two thirds of the payload's mass."""
    at = recorded()
    values = {"frequency": 5.8, "damping_ratio": 0.1, **chart([0.0, 1.0, 0.0]), **PLACE}
    assert SPRING.twins(at, {**values, "mass": 0.3 * at.phi[0]}) == ()
    assert SPRING.twins(at, {**values, "mass": 0.62 * at.phi[0]}) == ("grasp_compliance",)
