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
