"""Dark or shiny surface gives depth in single pixels, which look like those at edges: it is not left out."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import BRICK, EXACT, box, brick_views, views_of

from poise.fake_robots.rasteriser import Scene
from poise.scanning import ScanOptions, View, scan
from poise.scanning.fusion import raised_pixels, single_pixels
from poise.scanning.table_top import look_at
from poise.types import Array

VOLUME = float(np.prod(BRICK))


def darkened(view: View, lost: float, rng: np.random.Generator) -> View:
    """The view, where the half of the brick at negative x gives depth in some pixels only."""
    depth, places = view.frame.depth, places_of_pixels(view)
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


def places_of_pixels(view: View) -> Array:
    depth = view.frame.depth
    points = np.moveaxis(view.frame.camera.rays * depth, 0, -1)
    return np.asarray(np.dstack([points, depth]) @ view.rotation_world_camera.T + view.translation_world_camera)


def test_pieces_between_which_nothing_is_seen_may_be_one_object() -> None:
    """A band around the brick gives no depth at all; two bricks with the table between them have no such note."""
    views = []
    for view in brick_views():
        places = places_of_pixels(view)
        band = (np.abs(places[..., 0]) < 0.012) & (np.abs(places[..., 1]) < 0.04)
        views.append(replace(view, frame=replace(view.frame, depth=np.where(band, np.float32(0), view.frame.depth))))
    *_, count, notes = look_at(views, ScanOptions())
    assert count == 2
    assert any("if they are one object" in note for note in notes)
    apart = Scene(tuple(box((0.05, 0.06, 0.05), (x, 0.0, 0.025), (0.8, 0.2, 0.1)) for x in (-0.037, 0.037)))
    *_, count, notes = look_at(views_of(apart, noise=EXACT), ScanOptions())
    assert count == 2
    assert not any("if they are one object" in note for note in notes)


def test_what_floats_low_over_the_table_in_one_view_is_no_object() -> None:
    """Block matching raises pixels at the edges of a table, where other views have no depth: 29 were "objects"."""
    views, made = brick_views(), []
    angles = np.arange(len(views))[:, None] * 2.7 + [0.0, np.pi / 2]
    middles = 0.13 * np.cos(angles)
    for number, view in enumerate(views):
        places = places_of_pixels(view)
        near = np.linalg.norm(places[..., None, :2] - middles, axis=-1) < 0.01
        up = view.translation_world_camera[2]
        raised = np.where(near[..., number], view.frame.depth * (1 - 0.012 / up), view.frame.depth)
        depth = np.where(np.delete(near, number, axis=-1).any(axis=-1), 0.0, raised)
        made.append(replace(view, frame=replace(view.frame, depth=depth.astype(np.float32))))
    *_, count, notes = look_at(made, ScanOptions())
    assert (count, notes) == (1, [])
    flat = Scene(tuple(box((0.05, 0.06, 0.012), (x, 0.0, 0.006), (0.8, 0.2, 0.1)) for x in (-0.05, 0.05)))
    assert look_at(views_of(flat, noise=EXACT), ScanOptions())[2] == 2


def test_single_pixels_are_beside_unknown_ones_and_beside_no_edge() -> None:
    depth = np.full((7, 7), 0.5, np.float32)
    depth[3, 3] = 0.0
    depth[1, :] = 0.6
    rays = np.zeros((2, 7, 7), np.float32)
    given = (0, 7, 0, 7), 1, np.array([0.0, 0.0, -1.0, 1.0]), np.array([0.1, 0.9]), 6e-3
    assert set(single_pixels(depth, rays, *given)) == {3 * 7 + 2, 3 * 7 + 4, 4 * 7 + 3}
    assert not set(single_pixels(depth, rays, *given)) & set(raised_pixels(depth, rays, *given))
