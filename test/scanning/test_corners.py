"""A table that is seen lower beside the object: found with poses that are off, said, and in the stated uncertainty."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import BRICK, EXACT, box, brick_views, views_of
from test_moves import foreign

from poise.fake_robots.rasteriser import Scene
from poise.scanning import ScanOptions, View, scan
from poise.scanning.corners import sunken
from poise.scanning.table_top import look_at
from poise.types import Array

VOLUME = float(np.prod(BRICK))
DEEP, RADIUS = 1e-3, 0.02
"""m by which the table is seen lower, and how far from the brick."""


def exact_views() -> list[View]:
    return views_of(Scene((box(BRICK, (0.0, 0.0, 0.025), (0.8, 0.2, 0.1)),)), noise=EXACT)


def places_of(view: View) -> Array:
    """(H, W, 3) m in the world, of every pixel."""
    rays = np.concatenate([view.frame.camera.rays, np.ones((1, *view.frame.depth.shape))])
    return np.einsum("ij,jhw->hwi", view.rotation_world_camera, rays * view.frame.depth) + view.translation_world_camera


def in_corners(view: View, table: float, sides: float) -> View:
    """The view with the table beside the brick seen lower by so many m, and upright faces farther inside."""
    depth = view.frame.depth
    places = places_of(view)
    beside = np.linalg.norm(np.maximum(np.abs(places[..., :2]) - np.array(BRICK[:2]) / 2, 0), axis=2)
    on_table, upright = places[..., 2] < 1e-3, (places[..., 2] > 1e-3) & (places[..., 2] < BRICK[2] - 1e-3)
    eye = view.translation_world_camera
    falls, level = eye[2] - places[..., 2], np.linalg.norm(places[..., :2] - eye[:2], axis=2)  # per m of depth
    falls, level = (np.maximum(way, 1e-6) / np.maximum(depth, 1e-6) for way in (falls, level))
    longer = np.where(on_table & (beside < RADIUS), table / np.maximum(falls, 1e-6), 0.0)
    longer = np.where(upright, sides / np.maximum(level, 1e-6), longer)
    changed = np.where(depth > 0, depth + longer, 0).astype(np.float32)
    return replace(view, frame=replace(view.frame, depth=changed))


def found_in(views: list[View]) -> float:
    options = ScanOptions()
    return sunken(views, look_at(views, options)[1], options.farthest)


def test_it_is_found_where_single_poses_are_off_in_height() -> None:
    views = [in_corners(view, DEEP, 0.0) for view in exact_views()]
    assert found_in(views) == pytest.approx(DEEP, rel=0.1)
    rng = np.random.default_rng(4)
    off = [replace(v, translation_world_camera=v.translation_world_camera + rng.normal(size=3) * 1e-3) for v in views]
    assert found_in(off) == pytest.approx(DEEP, rel=0.15)


@pytest.mark.parametrize("noise", [0.0, 1e-3, 2e-3])
def test_a_flat_table_is_not_lower(noise: float) -> None:
    assert found_in(foreign(exact_views(), noise, seed=5)) == 0.0
    assert found_in(list(brick_views())) == 0.0


def test_the_volume_knows_it_and_a_note_says_so() -> None:
    """Faces pushed back by four times as much as the table: less than two sigmas, and five and more without it."""
    views = [in_corners(view, DEEP, 4 * DEEP) for view in exact_views()]
    found = scan(views, ScanOptions(refine="never"))
    assert [note for note in found.notes if "lower beside the object" in note]
    assert found.doubt is not None
    assert found.doubt[found.seen] == pytest.approx(np.hypot(2.5 * DEEP, found.posed), rel=0.15)
    solid = found.segmented().solid
    off = VOLUME - solid.volume
    assert 0 < off < 2 * solid.volume_std
    blind = replace(found, doubt=np.where(found.seen, found.posed, found.doubt)).segmented().solid
    assert off > 4 * blind.volume_std
