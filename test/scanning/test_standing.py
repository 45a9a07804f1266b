"""A scan as one closed mesh that stands: flat where it touches its support, and no wider there than it is."""

from functools import cache

import numpy as np
import pytest
from scenes import BRICK, brick_views

from poise.assembly import Analysis, Assembly, Box, Mesh, RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.manipulation import Hand
from poise.manipulation.grasps import antipodal_grasps
from poise.scanning import scan, standing_mesh, united_surfaces
from poise.shape import part_surface, segment

FLOOR = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose.from_vector([0, 0, -0.05, 0, 0, 0, 1]), fixed=True)


@cache
def brick():
    """Of a scanned brick: the surface of each part, as a message carries them."""
    scanned = scan(brick_views())
    found = segment(scanned.points, scanned.colours)
    parts = (part_surface(found.solid, found.tetrahedron_labels, part) for part in range(found.n_parts))
    return [(vertices - scanned.foot, triangles) for vertices, triangles in parts]


def test_a_scanned_brick_stands_flat_keeps_its_volume_and_can_be_grasped():
    made = standing_mesh(*united_surfaces(brick()))
    mesh = Mesh(made.vertices, made.triangles)
    assert mesh.volume == pytest.approx(np.prod(BRICK), rel=0.03)
    assert made.vertices[:, 2].min() == 0.0
    base = made.vertices[made.vertices[:, 2] == 0.0]
    np.testing.assert_allclose(np.ptp(base, axis=0)[:2], BRICK[:2], atol=4e-3)
    assert len(mesh.polyhedron.normals) < 600
    grasps = antipodal_grasps(mesh, Hand())
    assert any(abs(grasp.width - BRICK[1]) < 2e-3 for grasp in grasps)
    item = RigidObject("brick", mesh, Pose.identity(), mass=0.4)
    found = Analysis.of(Assembly((FLOOR, item))).stability()
    assert 0.7 * 0.4 * 9.81 < found.margin < 0.4 * 9.81


def test_parts_unite_without_the_faces_that_they_share():
    corners, triangles = united_surfaces(brick())
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert not np.any(np.unique(edges, axis=0, return_counts=True)[1] % 2)
    volume = Mesh(corners, triangles).volume
    assert volume == pytest.approx(sum(Mesh(*part).volume for part in brick()), rel=1e-4)


def ball(radius):
    """A fine sphere that touches z = 0 in one point."""
    turns, heights = np.meshgrid(np.linspace(0, 2 * np.pi, 48, endpoint=False), np.linspace(-1, 1, 40)[1:-1])
    across = radius * np.sqrt(1 - heights**2)
    ring = np.stack([across * np.cos(turns), across * np.sin(turns), radius * (1 + heights)], axis=-1).reshape(-1, 3)
    points = np.concatenate([ring, [[0, 0, 0], [0, 0, 2 * radius]]])
    i, j = np.meshgrid(np.arange(37), np.arange(48), indexing="ij")
    a, b = i * 48 + j, i * 48 + (j + 1) % 48
    sides = np.concatenate([np.stack(each, -1).reshape(-1, 3) for each in ([a, b, b + 48], [a, b + 48, a + 48])])
    around = np.arange(48)
    low = np.stack([np.full(48, len(points) - 2), (around + 1) % 48, around], -1)
    high = np.stack([np.full(48, len(points) - 1), 37 * 48 + around, 37 * 48 + (around + 1) % 48], -1)
    return points, np.concatenate([sides, low, high])


def test_a_ball_does_not_stand_on_the_disc_of_a_section_above_its_foot():
    made = standing_mesh(*ball(0.03))
    base = made.vertices[made.vertices[:, 2] == 0.0]
    assert np.linalg.norm(base[:, :2], axis=1).max() < 0.008  # the section 2 mm above has a radius of 10.8 mm
    assert "may roll" in made.notes[0]


def test_what_does_not_reach_its_support_is_refused():
    corners, triangles = united_surfaces(brick())
    with pytest.raises(InputError) as caught:
        standing_mesh(corners + np.array([0, 0, 0.02]), triangles)
    assert caught.value.code == ErrorCode.MESH_INVALID
