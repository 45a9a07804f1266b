"""The separate objects on a table, from points over it."""

import numpy as np

from poise.scanning.support import Plane, objects_on

TABLE = Plane(np.array([0.0, 0.0, 1.0]), 0.0, 7e-4)


def test_points_that_float_between_two_objects_do_not_join_them() -> None:
    """Depth at the edge of an object is a mixture with what is behind: a tenth of the points of a cell may float."""
    rng = np.random.default_rng(3)
    flat = rng.uniform(-0.15, 0.15, (200_000, 2))
    heights = rng.normal(0.0, 1e-3, len(flat))
    beside = np.abs(np.abs(flat[:, 0]) - 0.03) < 0.02  # two blocks, 20 mm apart
    on = beside & (np.abs(flat[:, 1]) < 0.02)
    between = (np.abs(flat[:, 0]) < 0.01) & (np.abs(flat[:, 1]) < 0.02) & (rng.random(len(flat)) < 0.1)
    heights[on], heights[between] = 0.06, rng.uniform(0.0, 0.06, int(between.sum()))
    found, middles = objects_on(np.column_stack([flat, heights]), TABLE)
    assert len(found) == 2
    assert np.allclose(np.sort(middles[:, 0]), [-0.03, 0.03], atol=5e-3)


def test_a_mirror_image_in_the_table_takes_nothing_away() -> None:
    """A glossy table shows a low block again below it, in as many points: the means of its cells were zero."""
    rng = np.random.default_rng(4)
    flat = rng.uniform(-0.1, 0.1, (100_000, 2))
    heights = rng.normal(0.0, 5e-4, len(flat))
    on = np.abs(flat).max(axis=1) < 0.03
    heights[on] += np.where(rng.random(int(on.sum())) < 0.5, 0.012, -0.012)
    (found,), middles = objects_on(np.column_stack([flat, heights]), TABLE)
    assert abs(found.top - 0.012) < 2e-3
    assert np.allclose(middles[0, :2], 0.0, atol=3e-3)
    assert found.holds(*np.array([[0.0, 0.025, -0.025], [0.0, 0.025, -0.025]])).all()
