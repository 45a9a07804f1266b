"""A scanned can is a cylinder, and nothing else is."""

import numpy as np
import pytest

from poise.scanning.cans import standing_cylinder

RADIUS, HEIGHT = 0.028, 0.07
NOISE = 4e-4
MIDDLE = np.array([0.004, -0.003])


def swept(radius_at, turns=(0.0, 2 * np.pi), top=True, seed=0):
    """Points (N, 3) m of a surface of revolution, whose radius is a function of height and angle, and of its top."""
    rng = np.random.default_rng(seed)
    heights, angles = rng.uniform(0, HEIGHT, 6000), rng.uniform(*turns, 6000)
    radii = radius_at(heights, angles) + rng.normal(scale=NOISE, size=6000)
    side = np.column_stack([radii * np.cos(angles), radii * np.sin(angles), heights])
    shares, around = np.sqrt(rng.uniform(0, 1, 1200)), rng.uniform(*turns, 1200)
    out = shares * radius_at(np.full(1200, HEIGHT), around)
    lids = HEIGHT + rng.normal(scale=NOISE, size=1200)
    lid = np.column_stack([out * np.cos(around), out * np.sin(around), lids])
    points = np.concatenate([side, lid]) if top else side
    return points + np.array([*MIDDLE, 0.0])


def found(points):
    return standing_cylinder(points, np.ones(len(points), bool))


def can(heights, angles):
    return RADIUS + 0 * heights


def test_a_can_is_found_within_a_tenth_of_a_millimetre():
    made = found(swept(can))
    assert made is not None
    assert made.radius == pytest.approx(RADIUS, abs=1e-4)
    assert made.height == pytest.approx(HEIGHT, abs=1e-4)
    np.testing.assert_allclose(made.middle, MIDDLE, atol=1e-4)
    np.testing.assert_allclose(made.pose.translation, [*made.middle, made.height / 2])


def test_points_of_the_foot_and_completed_ones_do_not_count():
    points = swept(can)
    skirt = np.array([*MIDDLE, 0.0]) + (points - [*MIDDLE, 0.0]) * [1.2, 1.2, 0.05]
    both = np.concatenate([points, skirt, points * [1.3, 1.3, 1.0]])
    seen = np.arange(len(both)) < 2 * len(points)
    made = standing_cylinder(both, seen)
    assert made is not None
    assert made.radius == pytest.approx(RADIUS, abs=1e-4)


def prism(sides):
    inner = RADIUS * np.cos(np.pi / sides)
    return lambda heights, angles: inner / np.cos(angles % (2 * np.pi / sides) - np.pi / sides)


@pytest.mark.parametrize(
    "points",
    [
        pytest.param(swept(lambda h, a: RADIUS + 0.03 * (h - HEIGHT / 2)), id="cone"),
        pytest.param(swept(lambda h, a: RADIUS + 0.003 * np.sin(np.pi * h / HEIGHT)), id="barrel"),
        pytest.param(swept(prism(8)), id="prism of 8 sides"),
        pytest.param(swept(lambda h, a: RADIUS * (1 + 0.05 * np.cos(2 * a))), id="oval"),
        pytest.param(swept(can, turns=(0.0, np.pi)), id="half of it was seen"),
        pytest.param(swept(can, top=False), id="no top"),
        pytest.param(swept(can) @ [[1, 0, 0], [0, 1, 0], [0.04, 0, 1]], id="leans"),
        pytest.param(swept(can)[:90], id="few points"),
    ],
)
def test_what_is_no_can_or_not_seen_to_be_one_is_none(points):
    assert found(points) is None


def test_a_cup_and_a_can_with_a_handle_are_none():
    wall, rng = swept(can, top=False), np.random.default_rng(1)
    floor = swept(can)[6000:] * [0.9, 0.9, 0.0] + [0, 0, 0.006]
    assert found(np.concatenate([wall, floor])) is None
    handle = rng.uniform([RADIUS, -0.004, 0.02], [RADIUS + 0.02, 0.004, 0.05], (150, 3))
    handle[:, :2] += MIDDLE
    assert found(np.concatenate([swept(can), handle])) is None
