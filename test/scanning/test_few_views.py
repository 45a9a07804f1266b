"""Sweeps of a dozen views: the flanks of what is round are seen by two of them."""

import numpy as np
import pytest
from manifold3d import Manifold
from scenes import EXACT, SMALL

from poise.fake_robots.depth_noise import D435, StereoNoise
from poise.fake_robots.rasteriser import Body, Scene, look_at
from poise.fake_robots.sweep_bag import FakeSweep, fake_views
from poise.scanning import View, fusion, scan
from poise.types import Array

RADIUS, LENGTH = 0.025, 0.12


def rod() -> tuple[Body, float]:
    """A cylinder that lies on the table, and its volume, m3."""
    made = Manifold.cylinder(LENGTH, RADIUS, RADIUS, 64, True).rotate((0.0, 90.0, 0.0)).translate((0.0, 0.0, RADIUS))
    mesh = made.to_mesh()
    corners = np.asarray(mesh.vert_properties[:, :3], float)[np.asarray(mesh.tri_verts)]
    return Body(corners, np.tile((0.7, 0.3, 0.2), (len(corners), 1))), made.volume()


def places(count: int) -> Array:
    """(V, 3) m, once around, low and high in turn."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False) + 0.1
    height = np.where(np.arange(count) % 2 == 0, 0.3, 0.9)
    ways = np.column_stack([np.cos(height) * np.cos(angle), np.cos(height) * np.sin(angle), np.sin(height)])
    return np.asarray(0.35 * ways + [0.0, 0.0, 0.02])


def views_of_rod(count: int, noise: StereoNoise) -> tuple[list[View], float]:
    body, volume = rod()
    point = np.array([0.0, 0.0, 0.02])
    at = places(count)
    turns = np.array([look_at(place, point) for place in at])
    sweep = FakeSweep(Scene((body,)), tuple(point), SMALL, noise, count, seed=1)
    return [view for view, _ in fake_views(sweep, turns, at)], volume


def test_flanks_that_two_views_see_are_surface(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three had to see them, so that a rod hung in the air; what two see, and none sees through, is there."""
    for noise, least in ((EXACT, 0.95), (D435, 0.85)):
        views, volume = views_of_rod(12, noise)
        solid = scan(views).segmented().solid
        assert solid.volume / volume > least
        assert abs(solid.volume - volume) < 2 * solid.volume_std
        with monkeypatch.context() as patch:
            patch.setattr(fusion, "_JUDGES", 3)
            assert scan(views).segmented().solid.volume < solid.volume - 0.04 * volume
