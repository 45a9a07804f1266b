"""Random objects have the stated properties, and objects that no constant was tuned on are cut into their parts."""

import numpy as np
import pytest

from benchmarks.random_objects import FIRST_TEST_SEED, Piece, _parts, _sampled, box, cone, make_composite
from poise.shape.carving import carve
from poise.shape.metrics import global_consistency_error, undersegmentation_error
from poise.shape.segmentation import segment

NOISE = 3e-4


def pieces() -> list[Piece]:
    """A cube of 0.1 m, and a bar of which half is inside the cube."""
    cube, bar = box(0.1, 0.1, 0.1)[0], box(0.1, 0.02, 0.02)[0] + np.array([0.05, 0.0, 0.0])
    return [Piece.around(0, cube), Piece.around(1, bar)]


def test_what_two_pieces_hold_is_counted_once_and_belongs_to_the_first() -> None:
    parts = _parts(pieces(), np.random.default_rng(0))
    assert parts.volumes == pytest.approx([1e-3, 0.05 * 0.02 * 0.02], rel=0.05)
    np.testing.assert_allclose(parts.unit_phi[1:4, 1], [0.075, 0, 0], atol=2e-3)
    np.testing.assert_allclose(parts.unit_phi[[4, 7, 9], 0], 0.1**2 / 6, rtol=0.05)


def test_points_lie_on_the_outside_only() -> None:
    both = pieces()
    points, labels = _sampled(both, np.random.default_rng(0), 4000)
    on_bar = labels == 1
    assert not both[0].holds(points[on_bar]).any()
    assert not both[1].holds(points[~on_bar]).any()
    assert points[on_bar, 0].min() >= 0.05 - 1e-9  # what is stuck in the cube has no surface
    assert np.mean(on_bar) == pytest.approx(0.0044 / (0.0044 + 0.06 - 0.0004), abs=0.015)


def test_a_cone_has_its_volume() -> None:
    parts = _parts([Piece.around(0, cone(0.3, 0.1, 0.0, 96)[0])], np.random.default_rng(0))
    assert parts.volumes[0] == pytest.approx(np.pi * 0.1**2 * 0.3 / 3, rel=0.01)


def test_the_same_seed_gives_the_same_object() -> None:
    one, again = make_composite(3, NOISE), make_composite(3, NOISE)
    np.testing.assert_array_equal(one.points, again.points)
    np.testing.assert_array_equal(one.colours, again.colours)
    np.testing.assert_array_equal(one.parts.unit_phi, again.parts.unit_phi)


def test_objects_that_nothing_was_chosen_on() -> None:
    unseen = [make_composite(seed, NOISE) for seed in range(FIRST_TEST_SEED, FIRST_TEST_SEED + 12)]
    found = [segment(one.points, one.colours) for one in unseen]
    pairs = [(mine.labels, one.labels) for mine, one in zip(found, unseen, strict=True)]
    assert np.mean([undersegmentation_error(*pair) for pair in pairs]) < 0.12
    assert np.mean([global_consistency_error(*pair) for pair in pairs]) < 0.09
    ratios = [carve(one.points).volume / one.volume for one in unseen]
    assert np.median(np.abs(np.array(ratios) - 1)) < 0.15
    assert np.all(np.abs(np.array(ratios) - 1) < 0.4)
