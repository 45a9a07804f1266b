"""Small scenes of known bodies on a table, and what a depth camera sees of them from all around."""

from dataclasses import replace
from functools import cache

import numpy as np

from poise.fake_robots.depth_noise import D435, StereoNoise
from poise.fake_robots.rasteriser import Body, Scene, look_at
from poise.fake_robots.sweep_bag import FakeSweep, fake_views
from poise.scanning import Camera, View
from poise.scanning.sweep import Ring

SMALL = Camera(200, 150, 190.0, 190.0, 99.5, 74.5)
EXACT = replace(D435, subpixel=0.0, step=1e-4, holes=0.0, flying=0.0, lost=0.0)
CUBE = np.array(
    [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6],
     [1, 3, 5], [3, 7, 5]]
)  # fmt: skip


def box(sides: tuple[float, float, float], at: tuple[float, float, float], colour: tuple[float, float, float]) -> Body:
    """A box with its middle at a place, m."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]) - 0.5
    triangles = (corners * sides + at)[CUBE]
    return Body(triangles, np.tile(colour, (len(triangles), 1)))


def views_of(
    scene: Scene,
    count: int = 24,
    target: tuple[float, float, float] = (0.0, 0.0, 0.02),
    noise: StereoNoise = D435,
    ring: Ring | None = None,
    camera: Camera = SMALL,
) -> list[View]:
    """Views from a ring around a point."""
    sweep = FakeSweep(scene, target, camera, noise, count, ring or Ring(low=0.4, high=1.1, sways=2), seed=1)
    point = np.array(target)
    places = sweep.ring.places(point, count)
    rotations = np.array([look_at(place, point) for place in places])
    return [view for view, _ in fake_views(sweep, rotations, places)]


BRICK = (0.12, 0.06, 0.05)


@cache
def brick_views() -> tuple[View, ...]:
    """A brick on the table, seen from all sides."""
    return tuple(views_of(Scene((box(BRICK, (0.0, 0.0, 0.025), (0.8, 0.2, 0.1)),))))
