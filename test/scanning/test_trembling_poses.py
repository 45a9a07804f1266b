"""Poses that are off by themselves, as a hand-held camera's: no error that all share is found in them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.fake_robots.rasteriser import look_at
from poise.scanning import Camera, Frame, View
from poise.scanning.depth_scale import depth_scale, rescaled
from poise.scanning.fusion import coarse_points
from poise.scanning.shared_errors import Path, without_shared
from poise.scanning.support import Plane, find_plane

CAMERA = Camera(160, 120, 96.0, 96.0, 79.5, 59.5)
TABLE = Plane(np.array([0.0, 0.0, 1.0]), 0.0, 1e-3)
JITTER = 3e-4, np.deg2rad(0.05)


def over_table(seed: int, jitter: tuple[float, float] = JITTER, count: int = 40) -> list[View]:
    """Views of an empty table from two heights, which take turns; depth has 0.8 mm of noise.

    Args:
        seed: of the noise, the jitter, and where a hand holds the camera.
        jitter: m and rad, one sigma along each axis, by which each pose is off.
        count: of the views.
    """
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    height = np.where(np.arange(count) % 2, np.deg2rad(54), np.deg2rad(27)) + rng.normal(scale=0.05, size=count)
    views = []
    for number in range(count):
        level, up = 0.4 * np.cos(height[number]), 0.4 * np.sin(height[number])
        place = np.array([level * np.cos(angle[number]), level * np.sin(angle[number]), up])
        turn = look_at(place, rng.normal(scale=0.01, size=3))
        down = np.tensordot(turn[2, :2], CAMERA.rays, axes=1) + turn[2, 2]
        depth = np.where(down < -0.05, -up / np.minimum(down, -0.05), 0.0)
        noisy = np.where((depth > 0) & (depth < 1.2), depth + rng.normal(scale=8e-4, size=depth.shape), 0.0)
        said = turn @ Rotation.from_rotvec(rng.normal(scale=jitter[1], size=3)).as_matrix()
        frame = Frame(number * 200_000_000, "camera", CAMERA, noisy.astype(np.float32))
        views.append(View(frame, said, place + rng.normal(scale=jitter[0], size=3)))
    return views


@pytest.mark.parametrize("seed", [2, 5])  # where every pixel counted alike, these had 2.0 and 1.5 %
def test_depth_is_not_taken_for_too_long(seed: int) -> None:
    assert depth_scale(over_table(seed), TABLE, 1.2) == 0.0


def test_depth_that_is_too_long_is_found_beside_them() -> None:
    views = rescaled(over_table(3), -0.025 / 1.025)
    plane = find_plane(coarse_points(views, 1.2), TABLE.normal, np.random.default_rng(0))
    assert depth_scale(views, plane, 1.2) == pytest.approx(0.025, abs=0.008)


@pytest.mark.parametrize("seed", [0])
def test_the_camera_is_not_moved_on_the_hand(seed: int) -> None:
    views = over_table(seed)
    assert without_shared(views, Path.of(views, None), TABLE, 1.2)[2] == []


def test_a_camera_that_is_moved_on_the_hand_is_found_beside_them() -> None:
    tilt = Rotation.from_rotvec([np.deg2rad(1.5), 0.0, 0.0]).as_matrix()
    views = [replace(view, rotation_world_camera=view.rotation_world_camera @ tilt) for view in over_table(3)]
    assert any("hand-eye" in note for note in without_shared(views, Path.of(views, None), TABLE, 1.2)[2])
