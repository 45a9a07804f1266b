"""Single views that are elsewhere than their poses say, or that something covers, are left out and named."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import BRICK, SMALL, box, brick_views, views_of
from scipy.spatial.transform import Rotation

from poise.errors import InputError
from poise.fake_robots.rasteriser import Scene
from poise.scanning import ScanOptions, View, scan
from poise.scanning.strays import without_strays
from poise.scanning.table_top import table_of

WRONG = (5, 14)
SLIM = (0.15, 0.012, 0.012)


def elsewhere(view: View) -> View:
    """The view with the pose that an arm has a while later: above the same table, around the same point, by 20 deg."""
    turn = Rotation.from_euler("z", 20, degrees=True).as_matrix()
    place = turn @ view.translation_world_camera + [0.03, -0.02, 0.0]
    return replace(view, rotation_world_camera=turn @ view.rotation_world_camera, translation_world_camera=place)


def covered(view: View) -> View:
    """The view with a hand before the lens."""
    depth = view.frame.depth.copy()
    depth[30:120, 40:160] = 0.18
    return replace(view, frame=replace(view.frame, depth=depth))


def with_wrong(views, change):
    return [change(view) if number in WRONG else view for number, view in enumerate(views)]


@pytest.mark.parametrize("change", [elsewhere, covered])
def test_single_wrong_views_change_no_volume_and_are_named(change) -> None:
    views = views_of(Scene((box(SLIM, (0.0, 0.0, 0.006), (0.8, 0.2, 0.1)),)))
    right, found = scan(views), scan(with_wrong(views, change))
    assert any(f"{len(WRONG)} of {len(views)} views" in note for note in found.notes)
    assert (found.n_objects, found.n_views) == (1, len(views) - len(WRONG))
    volumes = [one.segmented().solid.volume for one in (right, found)]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.06)
    assert not any("views show things" in note for note in right.notes)


def test_no_view_is_left_out_where_all_are_alike() -> None:
    """All poses tremble by 1 mm, an object that was moved in the middle of the sweep, and few views."""
    rng = np.random.default_rng(3)
    views = list(brick_views())
    trembling = [
        replace(view, translation_world_camera=view.translation_world_camera + rng.normal(0, 1e-3, 3)) for view in views
    ]
    after = views_of(Scene((box(BRICK, (0.05, 0.02, 0.025), (0.8, 0.2, 0.1)),)))
    for given in (views, trembling, views[:12] + after[12:], views[::3]):
        kept, said = without_strays(given, table_of(given, ScanOptions())[1], 1.2)
        assert (len(kept), said) == (len(given), [])


def test_many_wrong_views_are_not_explained_by_leaving_them_out() -> None:
    views = [elsewhere(view) if number % 2 else view for number, view in enumerate(brick_views())]
    try:
        notes = scan(views).notes
    except InputError:
        return
    assert any("agree" in note for note in notes)
    assert not any("views show things" in note for note in notes)


def test_a_table_without_anything_has_no_wrong_views() -> None:
    views = views_of(Scene(()), camera=SMALL)
    plane = table_of(views, ScanOptions())[1]
    assert without_strays(views, plane, 1.2)[1] == []
