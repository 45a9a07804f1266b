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
