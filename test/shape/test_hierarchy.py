"""What merging clusters costs, against closed forms and invariants."""

import numpy as np
import pytest
import shape_samples as samples
from scipy.spatial import cKDTree

from benchmarks import merge_odds
from poise.shape.carving import carve
from poise.shape.hierarchy import Hierarchy, MergeCosts, _extents, _moments, build_hierarchy
from poise.shape.segmentation import segment
from poise.shape.solid import Solid, part_moments
from poise.shape.surface_graph import surface_graph
from poise.types import Array, Indices


def block() -> Solid:
    """A box of 60 x 30 x 20 mm."""
    ends = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) - 0.5
    rng = np.random.default_rng(1)
    inner = rng.uniform(-0.49, 0.49, (200, 3))
    return carve(np.concatenate([ends, inner, inner.round() * 0.98]) * [0.06, 0.03, 0.02])


def halves(solid: Solid) -> Indices:
    return (solid.centroids[:, 0] > 0).astype(np.int64)


def test_moments_are_the_exact_integrals() -> None:
    solid = block()
    found, size = _moments(solid, halves(solid), 2), solid.volume ** (1 / 3)
    for part, exact in zip(found, part_moments(solid, halves(solid)), strict=True):
        turned = np.block([[np.eye(3), -solid.vertices.mean(axis=0)[:, None]], [np.zeros((1, 3)), 1.0]])
        moved = turned @ exact @ turned.T / solid.volume
        np.testing.assert_allclose(part[0], moved[3, 3], rtol=1e-9)
        np.testing.assert_allclose(part[1:4], moved[3, :3] / size, atol=1e-9)
        rows, columns = np.array([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]).T
        np.testing.assert_allclose(part[4:], moved[rows, columns] / size**2, atol=1e-9)


def test_ellipsoids_of_a_box_and_of_its_halves() -> None:
    """The root of the determinant of a box is its volume / 12^1.5; halves of a box have half of it each."""
    sides = np.array([3.0, 1.0, 0.5])
    whole = np.concatenate([[1.0], np.zeros(3), sides**2 / 12, np.zeros(3)])
    half = whole / 2
    half[4] = 0.5 * sides[0] ** 2 / 48 + 0.5 * (sides[0] / 4) ** 2
    half[1] = sides[0] / 8
    other = half * [1, -1, *[1] * 8]
    found = _extents(np.array([whole, half, other, half + other]))
    expected = sides.prod() / 12**1.5
    np.testing.assert_allclose(found, [expected, expected / 2, expected / 2, expected])


def merged(points: Array, colours: Array, leaves: Indices, solid: Solid) -> Hierarchy:
    moved = Solid(points, solid.tetrahedra, solid.neighbours)
    own = leaves[cKDTree(solid.centroids).query(solid.vertices)[1]]
    return build_hierarchy(moved, leaves, own, colours, surface_graph(moved), MergeCosts())


@pytest.mark.parametrize(("scale", "joins"), [(0.15, True), (0.5, False)])
def test_a_speck_beside_a_solid_is_of_the_part_that_is_nearest(scale: float, joins: bool) -> None:
    """Specks of noise touch nothing: each was a part of 0.0 % of the volume. A piece of 11 % stays one."""
    solid = block()
    small, count = scale * solid.vertices + [0.08, 0.0, 0.0], len(solid.tetrahedra)
    both = Solid(
        np.concatenate([solid.vertices, small]),
        np.concatenate([solid.tetrahedra, solid.tetrahedra + len(solid.vertices)]),
        np.concatenate([solid.neighbours, np.where(solid.neighbours < 0, -1, solid.neighbours + count)]),
    )
    leaves = np.concatenate([halves(solid), np.full(count, 2)])
    found = merged(both.vertices, np.full((len(both.vertices), 3), 0.5), leaves, both)
    assert len(found.merges) == (2 if joins else 1)
    assert {found.merges[0].left, found.merges[0].right} == ({1, 2} if joins else {0, 1})


def test_merges_do_not_depend_on_frame_and_unit() -> None:
    points, colours, _ = samples.mallet(np.random.default_rng(2), 500)
    solid = carve(points)
    leaves = np.unique((solid.centroids // 0.02).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = 7.0 * points @ turn.T + [0.3, -2.0, 1.0]
    one, other = merged(points, colours, leaves, solid), merged(moved, colours, leaves, solid)
    assert [(m.left, m.right) for m in one.merges] == [(m.left, m.right) for m in other.merges]
    np.testing.assert_allclose([m.cost for m in one.merges], [m.cost for m in other.merges], rtol=1e-6)


def test_the_merges_that_were_considered_are_those_of_the_hierarchy_and_their_terms_are_its_costs() -> None:
    points, colours, _ = samples.mallet(np.random.default_rng(2), 500)
    solid = carve(points)
    leaves = np.unique((solid.centroids // 0.02).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    own = leaves[cKDTree(solid.centroids).query(solid.vertices)[1]]
    given, costs = (solid, leaves, own, colours, surface_graph(solid)), MergeCosts(least=0.0)
    expected = build_hierarchy(*given, costs)
    considered: list[tuple[Array, Array]] = []
    found = build_hierarchy(*given, costs, considered)
    assert [(m.left, m.right) for m in found.merges] == [(m.left, m.right) for m in expected.merges]
    shares = np.bincount(own, minlength=leaves.max() + 1) / len(own)
    pairs, terms = (np.concatenate(column) for column in zip(*considered, strict=True))
    known = {(i, j): row for (i, j), row in zip(pairs.tolist(), terms, strict=True)}
    for merge in expected.merges[:5]:
        if max(merge.left, merge.right) <= leaves.max():
            odds = costs.constant + known[merge.left, merge.right] @ costs.weights
            cost = min(shares[merge.left], shares[merge.right]) * np.log1p(np.exp(odds))
            assert merge.cost == pytest.approx(cost)


def test_the_regression_of_merge_odds_finds_the_weights_that_labels_were_drawn_with() -> None:
    rng, count = np.random.default_rng(4), 20_000
    terms = np.insert(rng.normal(size=(count, 6)), 0, 1.0, axis=1)
    true = np.array([-1.0, 2.0, 0.5, -0.3, 0.0, 1.0, -2.0])
    apart = rng.random(count) < 1 / (1 + np.exp(-terms @ true))
    drawn = merge_odds.Pairs(terms, apart, rng.uniform(0.5, 1.5, count), rng.integers(0, 50, count))
    found, errors = merge_odds.fitted(drawn)
    assert np.all(np.abs(found - true) < 4 * errors)
    assert errors.max() < 0.1
    assert merge_odds.loss(drawn, found) <= merge_odds.loss(drawn, true)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_mallet_of_one_colour_is_cut_between_head_and_handle(noise: float) -> None:
    rng = np.random.default_rng(5)
    points, _, truth = samples.mallet(rng, 1500)
    found = segment(points + noise * rng.normal(size=points.shape))
    assert found.n_parts == 2
    table = np.array([[np.sum((found.labels == i) & (truth == j)) for j in range(2)] for i in range(2)])
    assert max(np.trace(table), np.trace(table[::-1])) > 0.95 * len(truth)
