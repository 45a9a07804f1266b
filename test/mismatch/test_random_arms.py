"""A slice of `benchmarks.random_arms`: an arm drawn at random, healthy and with friction in all joints."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.foreign.motions import STEP
from benchmarks.foreign.run import answer
from benchmarks.random_arms import DRY, bristles, recorded


@pytest.mark.parametrize("seed", [7002])
def test_a_random_arm_is_healthy_as_declared_and_has_its_friction_named(seed: int, tmp_path: Path) -> None:
    declared, friction = (answer(case, 300)["answer"] for case in recorded(seed, tmp_path))
    assert declared["verdict"] == "none"
    names = {effect["name"] for effect in friction["effects"]}
    assert names & set(DRY)
    assert friction["fit"]["holdout"]["augmented"] < 0.2 * friction["fit"]["holdout"]["nominal"]


def test_bristles_carry_the_dry_friction_after_a_distance() -> None:
    """At a constant speed the friction approaches its size as 1 - exp(-path / distance), and stays at rest."""
    velocity = np.concatenate([np.full(2000, 0.1), np.zeros(500)])[:, None]
    felt = bristles(velocity, np.array([10.0]), np.random.default_rng(1))[:, 0]
    assert 0.5 < felt[1999] < 10.0
    slope = 1.0 - felt[:1999] / felt[1999]
    path = 0.1 * STEP * np.arange(1, 2000)
    early = (slope > 0.05) & (path > 0.0)
    distance = -(np.polyfit(path[early], np.log(slope[early]), 1)[0] ** -1)
    assert 5e-4 < distance < 4e-3
    assert np.ptp(felt[2001:]) < 1e-12
