"""Grasps of rough surfaces: where a scan of a can is grasped, and what is not."""

import numpy as np
import pytest

from poise.assembly import Box, Cylinder, Mesh
from poise.manipulation import Hand
from poise.manipulation.probing import probed_grasps

UP = np.array([0.0, 0.0, 1.0])
RADIUS, HEIGHT = 0.025, 0.06


def rough(top: float = RADIUS, noise: float = 4e-4) -> Mesh:
    """A can as a scan shows it: many facets, rough, and wider at its foot; top: m, its radius there."""
    rng = np.random.default_rng(0)
    around, up = 48, 16
    angles = 2 * np.pi * np.arange(around) / around
    heights = np.linspace(0, HEIGHT, up)
    radii = np.linspace(RADIUS, top, up)[:, None] + rng.normal(0, noise, (up, around))
    radii[heights < 0.006] += 0.005
    side = np.stack([radii * np.cos(angles), radii * np.sin(angles), np.tile(heights[:, None], around)], axis=-1)
    vertices = np.vstack([side.reshape(-1, 3), [[0, 0, 0], [0, 0, HEIGHT]]])
    triangles = []
    for i in range(around):
        j = (i + 1) % around
        for k in range(up - 1):
            a, b, c, d = k * around + i, k * around + j, (k + 1) * around + j, (k + 1) * around + i
            triangles += [(a, b, c), (a, c, d)]
        triangles += [(around * up, j, i), (around * up + 1, (up - 1) * around + i, (up - 1) * around + j)]
    return Mesh(vertices, np.array(triangles))


def test_a_rough_can_is_grasped_across_its_middle_above_its_foot() -> None:
    can = rough()
    grasps = probed_grasps(can, Hand(), UP)
    assert len(grasps) > 10
    for grasp in grasps:
        tool = grasp.object_tcp
        assert tool.rotation[2, 2] == pytest.approx(-1.0)
        assert grasp.width == pytest.approx(2 * RADIUS, abs=0.003)
        assert abs(tool.rotation[:, 1] @ tool.translation) < 0.001  # the fingers meet it in the middle
        assert tool.translation[2] > 0.006


def test_what_narrows_or_is_too_wide_or_has_flat_faces_gets_none() -> None:
    assert not probed_grasps(rough(top=0.005), Hand(), UP)
    assert not probed_grasps(rough(), Hand(stroke=0.03), UP)
    assert not probed_grasps(Box((0.04, 0.04, 0.04)), Hand(), UP)
    assert not probed_grasps(Cylinder(0.02, 0.05), Hand(), UP)
