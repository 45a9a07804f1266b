"""Floors of hollows, where the shadow of a wall hides them."""

import numpy as np
from scenes import EXACT, box, views_of

from poise.fake_robots.rasteriser import Body, Scene
from poise.scanning import scan
from poise.scanning.floors import continued, floors

CELL = 2e-3
WALL, FLOOR = 0.08, 5e-3
SHAPE = (24, 24)
SHADOW = np.zeros(SHAPE, bool)
SHADOW[10:22, 2:22] = True


def mug() -> tuple[np.ndarray, np.ndarray]:
    """Tops of a square mug, and which of them are level; a heap of 10 to 40 mm stands on the right of its floor."""
    tops = np.full(SHAPE, WALL)
    tops[2:22, 2:22] = FLOOR
    tops[SHADOW] = np.repeat(np.linspace(0.01, 0.04, 12), 20)
    return tops, ~SHADOW


def test_a_floor_continues_below_the_shadow_of_a_wall() -> None:
    tops, level = mug()
    found = floors(tops, level, SHADOW, CELL)
    np.testing.assert_allclose(found[SHADOW], FLOOR, atol=1e-9)
    np.testing.assert_array_equal(found[~SHADOW], tops[~SHADOW])


def test_a_sloping_floor_continues_and_rises_nowhere_over_what_views_left() -> None:
    tops, level = mug()
    tops[2:10, 2:22] = FLOOR + 1e-3 * np.arange(20)
    found = floors(tops, level, SHADOW, CELL)
    assert np.all(found <= tops + 1e-12)
    inner = found[12:20, 4:20]
    assert np.all((inner > FLOOR) & (inner < FLOOR + 0.02))


def test_what_no_wall_hides_stays_as_the_views_left_it() -> None:
    """A knob that gives no depth stands on a level block: nothing higher casts a shadow there."""
    tops = np.full(SHAPE, FLOOR)
    tops[SHADOW] = 0.03
    np.testing.assert_array_equal(floors(tops, ~SHADOW, SHADOW, CELL), tops)


def test_a_hollow_without_any_floor_seen_stays_filled() -> None:
    tops, _ = mug()
    np.testing.assert_array_equal(floors(tops, np.zeros(SHAPE, bool), SHADOW, CELL), tops)


def test_a_level_height_is_that_of_columns_near_it_but_not_of_a_wall() -> None:
    tops, level = np.full((8, 1), FLOOR), np.zeros((8, 1), bool)
    level[0] = True
    tops[1], tops[2] = FLOOR + 1e-3, FLOOR - 4e-3
    heights, known = continued(tops, level, np.ones((8, 1), bool), CELL)
    np.testing.assert_array_equal(known[:, 0], np.arange(8) < 2)
    np.testing.assert_array_equal(heights[[0, 1], 0], FLOOR)


def test_a_deep_box_whose_floor_is_seen_in_part_has_its_volume() -> None:
    """The camera is never high enough to see all of the floor; such mugs were refused, since "no view gives depth"."""
    side, high, wall = 0.06, 0.085, 5e-3
    parts = [box((side, side, wall), (0.0, 0.0, wall / 2), (0.5, 0.5, 0.6))]
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        sides = (wall if x else side, wall if y else side, high)
        at = (x * (side - wall) / 2, y * (side - wall) / 2, high / 2)
        parts.append(box(sides, at, (0.5, 0.5, 0.6)))
    bodies: tuple[Body, ...] = tuple(parts)
    found = scan(views_of(Scene(bodies), 24, (0.0, 0.0, 0.05), EXACT))
    inner = side - 2 * wall
    volume = side**2 * high - inner**2 * (high - wall)
    solid = found.segmented().solid
    assert abs(solid.volume / volume - 1) < 0.15
    assert abs(solid.volume - volume) < 2 * solid.volume_std
