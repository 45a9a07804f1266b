"""Depth that is too long or too short by a share is found from the table, and an object has its size again."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import BRICK, box, brick_views, views_of
from scipy.spatial.transform import Rotation

from poise.fake_robots.rasteriser import Scene
from poise.scanning import View, scan
from poise.scanning.depth_scale import depth_scale, rescaled
from poise.scanning.options import DEFAULT_SCAN
from poise.scanning.support import find_plane

UP = np.array([0.0, 0.0, 1.0])


def longer(views: list[View], share: float) -> list[View]:
    """What a camera sees whose depth is too long by a share."""
    return [replace(view, frame=replace(view.frame, depth=view.frame.depth * np.float32(1 + share))) for view in views]


def found_in(views: list[View]) -> float:
    from poise.scanning.fusion import coarse_points

    plane = find_plane(coarse_points(views, DEFAULT_SCAN.farthest), UP, np.random.default_rng(0))
    return depth_scale(views, plane, DEFAULT_SCAN.farthest)


@pytest.mark.parametrize("share", [-0.012, -0.006, 0.006, 0.012])
def test_the_share_is_found(share: float) -> None:
    assert found_in(longer(list(brick_views()), share)) == pytest.approx(share, abs=0.0025)


def test_depth_that_is_right_stays() -> None:
    assert found_in(list(brick_views())) == 0.0
    assert found_in(longer(list(brick_views()), 0.006)[:12]) == 0.0  # few views do not show it


def test_a_camera_that_is_turned_on_the_hand_is_no_share() -> None:
    turn = Rotation.from_rotvec([0.006, 0.0, 0.003]).as_matrix()
    views = [replace(view, rotation_world_camera=view.rotation_world_camera @ turn) for view in brick_views()]
    assert abs(found_in(views)) < 0.005


def test_views_from_one_height_do_not_show_it() -> None:
    from poise.scanning.sweep import Ring

    level = Ring(low=0.8, high=0.8)
    views = views_of(Scene((box(BRICK, (0.0, 0.0, 0.025), (0.8, 0.2, 0.1)),)), 24, ring=level)
    assert found_in(longer(views, 0.01)) == 0.0


def test_rescaled_depth_is_as_it_was() -> None:
    views = list(brick_views())[:2]
    for before, after in zip(views, rescaled(longer(views, 0.02), 0.02), strict=True):
        np.testing.assert_allclose(after.frame.depth, before.frame.depth, rtol=1e-6)


@pytest.mark.parametrize("share", [-0.01, 0.01])
def test_the_volume_is_right_and_the_cause_is_said(share: float) -> None:
    found = scan(longer(list(brick_views()), share))
    solid = found.segmented().solid
    assert solid.volume == pytest.approx(np.prod(BRICK), rel=0.06)
    word = "long" if share > 0 else "short"
    assert any(f"too {word}" in note for note in found.notes)
