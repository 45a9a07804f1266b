"""Hulls by outermost points: volumes of bodies that are known, and of their unions."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from poise.shape.hulls import Hulls

BOX = np.array(np.meshgrid([-0.05, 0.05], [-0.02, 0.02], [-0.01, 0.01])).reshape(3, -1).T


def test_a_box_is_exact() -> None:
    assert Hulls.of([BOX]).volumes[0] == pytest.approx(0.1 * 0.04 * 0.02)


def test_the_union_of_boxes_has_the_volume_of_their_hull() -> None:
    others = [BOX + np.array([x, 0.0, 0.0]) for x in (0.0, 0.1, 0.3)]
    found = Hulls.of([BOX]).with_each(Hulls.of(others)).volumes
    np.testing.assert_allclose(found, [(0.1 + x) * 0.04 * 0.02 for x in (0.0, 0.1, 0.3)])


@pytest.mark.parametrize("seed", range(4))
def test_random_sets_have_most_of_the_volume_of_their_hull(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sets = [rng.normal(size=(60, 3)) @ np.diag([1.0, 0.5, 0.3]) for _ in range(10)]
    share = Hulls.of(sets).volumes / [ConvexHull(one).volume for one in sets]
    assert share.min() > 0.85
    assert share.max() < 1 + 1e-9


def test_flat_sets_have_no_volume() -> None:
    flat = np.random.default_rng(0).normal(size=(30, 3)) * [1, 1, 0]
    assert Hulls.of([flat]).volumes[0] == pytest.approx(0, abs=1e-12)
