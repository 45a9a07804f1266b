"""Dark or shiny surface gives depth in single pixels, which look like those at edges: it is not left out."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import BRICK, brick_views

from poise.scanning import View, scan
from poise.scanning.fusion import raised_pixels, single_pixels

VOLUME = float(np.prod(BRICK))


def darkened(view: View, lost: float, rng: np.random.Generator) -> View:
    """The view, where the half of the brick at negative x gives depth in some pixels only."""
    depth = view.frame.depth
    points = np.moveaxis(view.frame.camera.rays * depth, 0, -1)
    places = np.dstack([points, depth]) @ view.rotation_world_camera.T + view.translation_world_camera
    dark = (places[..., 0] < 0.0) & (places[..., 2] > 3e-3)
    kept = ~dark | (rng.random(depth.shape) > lost)
    return replace(view, frame=replace(view.frame, depth=np.where(kept, depth, np.float32(0))))


@pytest.mark.parametrize("lost", [0.5, 0.8])
def test_half_of_a_brick_that_is_dark_is_scanned(lost: float) -> None:
    """Without single pixels, 0.8 leave 0.6 of the volume."""
    rng = np.random.default_rng(3)
    found = scan([darkened(view, lost, rng) for view in brick_views()])
    solid = found.segmented().solid
    assert solid.volume == pytest.approx(VOLUME, rel=0.15)
    assert abs(solid.volume - VOLUME) < 2 * solid.volume_std
    assert any("dark or shiny" in note for note in found.notes)


def test_a_bright_brick_has_no_such_note() -> None:
    assert not any("dark or shiny" in note for note in scan(brick_views()).notes)


def test_single_pixels_are_beside_unknown_ones_and_beside_no_edge() -> None:
    depth = np.full((7, 7), 0.5, np.float32)
    depth[3, 3] = 0.0
    depth[1, :] = 0.6
    rays = np.zeros((2, 7, 7), np.float32)
    given = (0, 7, 0, 7), 1, np.array([0.0, 0.0, -1.0, 1.0]), np.array([0.1, 0.9]), 6e-3
    assert set(single_pixels(depth, rays, *given)) == {3 * 7 + 2, 3 * 7 + 4, 4 * 7 + 3}
    assert not set(single_pixels(depth, rays, *given)) & set(raised_pixels(depth, rays, *given))
