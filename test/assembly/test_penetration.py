"""Overlap of bodies that are not convex, where their faces coincide, too."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.placement.scenes import CELL, GLUED, glued
from poise.assembly import Pose, RigidObject
from poise.assembly.contacts import CONTACT_MARGIN
from poise.assembly.penetration import penetration_depth
from poise.assembly.placed import PlacedBody


def cuboids(item: RigidObject) -> tuple[np.ndarray, np.ndarray]:
    """(K, 3) lowest and highest corners of the cuboids it was glued from, in its own frame."""
    sizes = np.array(GLUED[item.id], dtype=np.float64) * CELL
    origin = item.shape.polyhedron.vertices.min(axis=0) - sizes[:, :3].min(axis=0)
    return sizes[:, :3] + origin, sizes[:, 3:] + origin


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("names", ["de", "ag", "fj", "hi", "cb"])
def test_glued_objects_on_one_grid_overlap_when_cuboids_do(names: str, turned: bool) -> None:
    """Shifted by half cells, so that many faces lie in faces; to the last bit, or but for rounding."""
    first, second = map(glued, names)
    rng = np.random.default_rng(5)
    turn = Rotation.random(rng=rng).as_matrix() if turned else np.eye(3)
    (low_a, high_a), (low_b, high_b) = cuboids(first), cuboids(second)
    overlapping = 0
    for _ in range(80):
        shift = rng.integers(-6, 7, 3) * CELL / 2
        common = np.minimum(high_a[:, None], high_b + shift) - np.maximum(low_a[:, None], low_b + shift)
        really = bool(np.all(common > 1e-6, axis=2).any())
        overlapping += really
        there = Pose(turn, turn @ shift + np.array([0.3, -0.2, 0.1]))
        here = Pose(turn, np.array([0.3, -0.2, 0.1]))
        bodies = [PlacedBody(RigidObject(i.id, i.shape, p, mass=1.0)) for i, p in ((first, here), (second, there))]
        assert (penetration_depth(*bodies) > CONTACT_MARGIN) == really
    assert 16 < overlapping < 76
