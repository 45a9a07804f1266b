"""Poses and depth that mean something else are named; views that agree are not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenes import BRICK, box, views_of
from scipy.spatial.transform import Rotation

from poise.fake_robots.rasteriser import Scene
from poise.geometry import Pose
from poise.scanning import Ring, Sweep
from poise.scanning.causes import likely_cause
from poise.scanning.conventions import other_meaning, ray_lengths

UP = np.array([0.0, 0.0, 1.0])
OPTICAL_IN_LINK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@cache
def seen():
    return tuple(views_of(Scene((box(BRICK, (0.0, 0.0, 0.025), (0.8, 0.2, 0.1)),)), 12, ring=Ring(low=0.4, high=1.1)))


def inverted(view):
    pose = Pose(view.rotation_world_camera, view.translation_world_camera).inverse
    return replace(view, rotation_world_camera=pose.rotation, translation_world_camera=pose.translation)


def opengl(view):
    return replace(view, rotation_world_camera=view.rotation_world_camera @ np.diag([1.0, -1.0, -1.0]))


def link(view):
    return replace(view, rotation_world_camera=view.rotation_world_camera @ OPTICAL_IN_LINK.T)


def distances(view):
    depth = (view.frame.depth * ray_lengths(view.frame.camera)).astype(np.float32)
    return replace(view, frame=replace(view.frame, depth=depth))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [(inverted, "poses are inverted"), (opengl, "as in OpenGL"), (link, "x points forward"), (distances, "distance")],
)
def test_another_meaning_is_named(wrong, words):
    views = [wrong(view) for view in seen()]
    assert words in likely_cause(Sweep(views, "base"), UP, 1.2)


def test_no_other_meaning_is_named_for_a_camera_that_is_turned_on_the_hand():
    turn = Rotation.from_rotvec(np.deg2rad([4.0, 0.0, 0.0])).as_matrix()
    views = [replace(view, rotation_world_camera=view.rotation_world_camera @ turn) for view in seen()]
    assert other_meaning(views, UP, 1.2, 0.02) == ""


def test_a_ray_is_as_long_as_its_point_is_far():
    camera = seen()[0].frame.camera
    row, column = 3, camera.width - 5
    point = np.array([(column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, 1.0])
    assert ray_lengths(camera)[row, column] == pytest.approx(np.linalg.norm(point))
