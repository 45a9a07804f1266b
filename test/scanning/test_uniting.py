"""Pieces of a height map are one object where one surface connects them."""

from dataclasses import replace

import numpy as np
from scenes import box, views_of

from poise.fake_robots.rasteriser import Scene
from poise.scanning.options import ScanOptions
from poise.scanning.support import Footprint
from poise.scanning.table_top import table_of, things_on
from poise.scanning.uniting import united

GREY = (0.5, 0.5, 0.6)
ENDS = [box((0.03, 0.03, 0.03), (x, 0.0, 0.015), GREY) for x in (-0.05, 0.05)]
ROD = box((0.08, 0.006, 0.006), (0.0, 0.0, 0.015), GREY)


def divided(scene: Scene) -> tuple[list[Footprint], np.ndarray]:
    """What stands on the table, if the map divides it in the middle (x = 0)."""
    views = views_of(scene)
    options = ScanOptions()
    points, plane = table_of(views, options)
    found = things_on(views, points, plane, options)[0]
    cells = np.any([one.cells for one in found], axis=0)
    columns = found[0].low[0] + 3e-3 * (np.arange(cells.shape[0]) + 0.5)
    bridge = np.abs(columns) < 0.05
    cells[np.ix_(bridge, np.abs(found[0].low[1] + 3e-3 * (np.arange(cells.shape[1]) + 0.5)) < 8e-3)] = True
    halves = [replace(found[0], cells=cells & side[:, None]) for side in (columns < 0, columns >= 0)]
    middles = np.array([[-0.04, 0.0, 0.01], [0.04, 0.0, 0.01]])
    return united(views, halves, middles, options.voxel)


def test_a_thin_rod_between_two_pieces_makes_them_one() -> None:
    (one,), middles = divided(Scene((*ENDS, ROD)))
    assert one.holds(np.array([-0.05, 0.0, 0.05]), np.zeros(3)).all()
    np.testing.assert_allclose(middles[0, :2], 0.0, atol=5e-3)


def test_two_objects_between_which_no_surface_is_stay_two() -> None:
    found, middles = divided(Scene(tuple(ENDS)))
    assert len(found) == 2
    np.testing.assert_allclose(np.sort(middles[:, 0]), [-0.04, 0.04])
