"""Overlap of bodies that are not convex, where their faces coincide, too."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.placement.scenes import CELL, GLUED, glued
from poise.assembly import Box, Cylinder, Mesh, RigidObject
from poise.assembly.contact.contacts import CONTACT_MARGIN
from poise.assembly.contact.penetration import penetration_depth
from poise.assembly.contact.placed import PlacedBody
from poise.geometry import Pose


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


def test_beside_the_round_of_a_cylinder_there_is_room() -> None:
    can = RigidObject("can", Cylinder(0.05, 0.1), Pose(np.eye(3), np.array([0.0, 0.0, 0.05])), mass=1.0)
    for place, touches in ((0.045, False), (0.03, True)):
        post = replace(glued("a"), pose=Pose(np.eye(3), np.array([place, place, 0.02])))
        assert (penetration_depth(PlacedBody(can), PlacedBody(post)) > 0) == touches


def test_of_many_points_inside_the_deepest_counts() -> None:
    """A corrugated slab, a tenth of a millimetre deep in a box everywhere, and at one late corner much deeper."""
    side, deep = 24, 4e-3
    x, y = np.meshgrid(np.linspace(0, 0.1, side), np.linspace(0, 0.1, side), indexing="ij")
    low = np.where((np.arange(side)[:, None] + np.arange(side)) % 2, -1e-4, -2e-4)
    low[-2, -2] = -deep
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    under = np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)])
    rim = [number[0], number[1:, -1], number[-1, -2::-1], number[-2:0:-1, 0]]
    loop = np.concatenate(rim)
    walls = []
    for here, there in zip(loop, np.roll(loop, -1), strict=True):
        walls += [[here, there, there + side**2], [here, there + side**2, here + side**2]]
    over = under[:, ::-1] + side**2
    vertices = np.concatenate(
        [np.stack([x, y, low], axis=-1).reshape(-1, 3), np.stack([x, y, 0 * x + 0.02], axis=-1).reshape(-1, 3)]
    )
    slab = Mesh(vertices, np.concatenate([under, over, walls]))
    assert slab.volume > 0
    table = RigidObject("table", Box((0.4, 0.4, 0.1)), Pose(np.eye(3), np.array([0.05, 0.05, -0.05])), fixed=True)
    bodies = PlacedBody(RigidObject("slab", slab, Pose(np.eye(3), np.zeros(3)), mass=1.0)), PlacedBody(table)
    assert penetration_depth(*bodies) == pytest.approx(deep, abs=1e-9)
