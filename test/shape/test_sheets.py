"""Folds of sheets, against walls of known thickness, and against necks, which are none."""

import numpy as np
import pytest
import shape_samples as samples

from poise.shape.hierarchy import MergeCosts, build_hierarchy
from poise.shape.reconstruction import Reconstruction, reconstruct
from poise.shape.segmentation import segment
from poise.shape.sheets import opposite_points, sheet_folds
from poise.shape.surface_graph import INWARDS, surface_graph
from poise.types import Array

WALL = 0.005


def tray(rng: np.random.Generator, count: int) -> Array:
    """(count, 3) m on an open box of 90 x 70 x 40 mm with walls and a bottom of `WALL`."""
    size, hole = np.array([0.09, 0.07, 0.04]), np.array([0.09 - 2 * WALL, 0.07 - 2 * WALL, 0.04])
    inner = samples.box(rng, tuple(hole), 3 * count, np.array([0, 0, WALL]))
    points = np.concatenate([samples.box(rng, tuple(size), 4 * count), inner])
    above = points[:, 2] > size[2] / 2 - 1e-9
    bare = above & np.all(np.abs(points[:, :2]) < hole[:2] / 2, axis=1)
    return rng.permutation(points[~bare & (points[:, 2] < size[2] / 2 + 1e-9)])[:count]


def made(points: Array, noise: float, rng: np.random.Generator) -> Reconstruction:
    return reconstruct(points + noise * rng.normal(size=points.shape), 2500)


def test_opposite_of_a_plate_is_its_other_face() -> None:
    rng = np.random.default_rng(1)
    found = made(samples.box(rng, (0.1, 0.08, 0.008), 2500), 0.0, rng).carved
    opposite = opposite_points(found, surface_graph(found).normals, np.ones(len(found.vertices), bool))
    x, y, z = found.vertices.T
    inner = (np.abs(x) < 0.045) & (np.abs(y) < 0.035) & (np.abs(z) > 0.0039)
    assert np.mean(opposite[inner] >= 0) > 0.99
    assert np.mean(z[opposite[inner]] * z[inner] < 0) > 0.97


@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_turns_of_a_wall_are_folds_and_a_neck_is_none(noise: float) -> None:
    rng = np.random.default_rng(2)
    shares = []
    for points in (tray(rng, 2500), samples.mallet(rng, 2500)[0]):
        found = made(points, noise, rng)
        graph = surface_graph(found.solid)
        folded = sheet_folds(found.carved, graph)
        assert not np.any(folded & (graph.creases <= INWARDS))
        shares.append(np.count_nonzero(folded) / np.count_nonzero(graph.creases > INWARDS))
    assert shares[0] > 0.25
    assert shares[1] < 0.05


def test_folds_do_not_depend_on_frame_and_unit() -> None:
    rng = np.random.default_rng(3)
    points = tray(rng, 1500)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    first, other = (reconstruct(some, 2500, 0.0) for some in (points, points @ turn.T + [0.3, -0.2, 1.0]))
    counts = [np.count_nonzero(sheet_folds(one.carved, surface_graph(one.solid))) for one in (first, other)]
    assert counts[0] == pytest.approx(counts[1], rel=0.1)


@pytest.mark.parametrize("seed", range(4, 7))
def test_a_tray_is_one_to_three_parts(seed: int) -> None:
    """Its bottom and its four walls were five."""
    rng = np.random.default_rng(seed)
    points = tray(rng, 2500) + 3e-4 * rng.normal(size=(2500, 3))
    assert segment(points).n_parts <= 3


def test_a_wider_ellipsoid_is_that_of_the_box_and_a_cube_together() -> None:
    """Covariances of what is convolved add up: merging two halves of a box costs what the closed form says."""
    rng = np.random.default_rng(8)
    solid = reconstruct(samples.box(rng, (0.1, 0.06, 0.03), 2500), 2500, 0.0).carved
    leaves = (solid.centroids[:, 0] > 0).astype(np.int64)
    own = (solid.vertices[:, 0] > 0).astype(np.int64)
    considered: list[tuple[Array, Array]] = []
    graph, costs = surface_graph(solid), MergeCosts(blur=0.2)
    build_hierarchy(solid, leaves, own, np.zeros_like(solid.vertices), graph, costs, considered)
    sides = np.array([0.1, 0.06, 0.03])
    added = 12 * (0.2 * np.cbrt(sides.prod())) ** 2
    whole, half = (np.sqrt(np.prod((sides / [parts, 1, 1]) ** 2 + added)) for parts in (1, 2))
    assert considered[0][1][0, 2] == pytest.approx(np.log(whole / (2 * half)), abs=0.03)
