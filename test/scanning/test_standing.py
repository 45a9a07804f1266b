"""A scan as one closed mesh that stands: flat where it touches its support, and no wider there than it is."""

from functools import cache

import manifold3d
import numpy as np
import pytest
from scenes import BRICK, brick_views

from poise.assembly import Analysis, Assembly, Box, Cylinder, Mesh, RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.manipulation import Hand
from poise.manipulation.grasps import antipodal_grasps
from poise.scanning import scan, standing_mesh, united_surfaces
from poise.scanning.faceted import faceted
from poise.shape import part_surface, segment
from poise.worlds import convex_pieces

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


def cloud():
    """Of the scanned brick: points in the object frame, and which were seen."""
    scanned = scan(brick_views())
    return scanned.points - scanned.foot, scanned.seen


def test_with_its_points_a_scanned_brick_is_a_box_within_half_a_millimetre():
    made = standing_mesh(*united_surfaces(brick()), "brick", *cloud())
    mesh = Mesh(made.vertices, made.triangles)
    assert mesh.volume == pytest.approx(np.prod(BRICK), rel=0.015)
    np.testing.assert_allclose(mesh.centroid, [0, 0, BRICK[2] / 2], atol=5e-4)
    assert len(mesh.polyhedron.normals) <= 10
    assert len(convex_pieces(mesh.polyhedron)) <= 3
    assert area_at(mesh, [0, 0, -1], 0.0) == pytest.approx(BRICK[0] * BRICK[1], rel=0.03)
    assert area_at(mesh, [0, 0, 1], BRICK[2]) == pytest.approx(BRICK[0] * BRICK[1], rel=0.03)


def area_at(mesh, normal, offset):
    """m2 of the largest facet with this normal, up to 1 degree, whose plane has this offset up to .5 mm."""
    solid = mesh.polyhedron
    flat = [
        facet
        for facet in np.flatnonzero(solid.normals @ normal > np.cos(np.radians(1.0))).tolist()
        if abs(solid.vertices[solid.facet_vertices[facet]] @ normal - offset).max() < 5e-4
    ]
    return max(solid.polygon(facet, solid.vertices, np.zeros(3), np.eye(3)[:2]).area for facet in flat)


def sampled(mesh, spacing, noise, seed=0):
    """Points on the surface of a mesh, about one in each square of the spacing, with noise along the normals."""
    rng = np.random.default_rng(seed)
    corners = mesh.vertices[mesh.triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(cross, axis=1) / 2
    rows = rng.choice(len(areas), int(areas.sum() / spacing**2), p=areas / areas.sum())
    shares = rng.dirichlet(np.ones(3), len(rows))
    normals = cross[rows] / (2 * areas[rows, None])
    return np.einsum("ni,nij->nj", shares, corners[rows]) + rng.normal(scale=noise, size=(len(rows), 1)) * normals


def standing(shape, height):
    """A shape, with its middle at half of the height, as an exact mesh that stands on z = 0."""
    solid = shape.polyhedron
    return Mesh(solid.vertices + np.array([0, 0, height / 2]), solid.triangles)


@pytest.mark.parametrize("noise", [0.0, 2e-4])
def test_a_can_gets_no_flat_side_to_rest_on(noise):
    can = standing(Cylinder(0.03, 0.08), 0.08)
    points = sampled(can, 1.5e-3, noise)
    made = faceted(solid_of(can), points, np.ones(len(points), bool), 0.004, 0.001)
    assert made is None or widest_side(mesh_of(made), 0.08) < 0.006
    kept = standing_mesh(can.vertices, can.triangles, "can", points, np.ones(len(points), bool))
    assert Mesh(kept.vertices, kept.triangles).volume == pytest.approx(can.volume, rel=0.04)


def mesh_of(body):
    cut = body.to_mesh64()
    return Mesh(np.array(cut.vert_properties)[:, :3], np.array(cut.tri_verts, dtype=np.int64))


def test_a_box_with_a_round_side_has_none_that_is_flat_there():
    turns = np.linspace(-np.pi / 2, np.pi / 2, 40)
    outline = np.column_stack([0.03 * np.cos(turns), 0.03 * np.sin(turns)]).tolist()
    loaf = extruded([*outline, [-0.04, 0.03], [-0.04, -0.03]], 0.07)
    points = sampled(loaf, 1.5e-3, 1e-4)
    made = faceted(solid_of(loaf), points, np.ones(len(points), bool), 0.004, 0.001)
    if made is not None:
        sides = mesh_of(made).polyhedron
        ahead = np.flatnonzero(sides.normals[:, 0] > 0.3)
        corners = [sides.vertices[sides.facet_triangles[k]] for k in ahead]
        areas = [
            np.linalg.norm(np.cross(each[:, 1] - each[:, 0], each[:, 2] - each[:, 0]).sum(axis=0)) / 2
            for each in corners
        ]
        assert max(areas) < 0.006 * 0.07
        assert made.volume() == pytest.approx(loaf.volume, rel=0.02)


def widest_side(mesh, height):
    """m: the largest upright facet of a prism, divided by its height."""
    solid = mesh.polyhedron
    corners = [solid.vertices[solid.facet_triangles[k]] for k in np.flatnonzero(np.abs(solid.normals[:, 2]) < 0.3)]
    crosses = [np.cross(each[:, 1] - each[:, 0], each[:, 2] - each[:, 0]).sum(axis=0) for each in corners]
    return max(np.linalg.norm(cross) / 2 / height for cross in crosses)


def test_an_angle_keeps_its_inner_corner():
    angle = extruded([[0, 0], [0.06, 0], [0.06, 0.025], [0.025, 0.025], [0.025, 0.05], [0, 0.05]], 0.07)
    points = sampled(angle, 1.5e-3, 2e-4)
    made = standing_mesh(angle.vertices, angle.triangles, "angle", points, np.ones(len(points), bool))
    mesh = Mesh(made.vertices, made.triangles)
    assert mesh.volume == pytest.approx(angle.volume, rel=0.01)
    np.testing.assert_allclose(mesh.centroid, angle.centroid, atol=3e-4)
    assert len(mesh.polyhedron.normals) <= 10
    assert len(convex_pieces(mesh.polyhedron)) <= 3


def extruded(outline, height):
    """A prism that stands on z = 0."""
    body = manifold3d.Manifold.extrude(manifold3d.CrossSection([outline]), height).to_mesh64()
    return Mesh(np.array(body.vert_properties)[:, :3], np.array(body.tri_verts, dtype=np.int64))


def test_a_foot_that_is_only_completed_does_not_widen_the_base():
    can = standing(Cylinder(0.03, 0.08), 0.08)
    skirt = standing(Cylinder(0.036, 0.003), 0.003)
    both = manifold3d.Manifold.batch_boolean([solid_of(can), solid_of(skirt)], manifold3d.OpType.Add).to_mesh64()
    flared = Mesh(np.array(both.vert_properties)[:, :3], np.array(both.tri_verts, dtype=np.int64))
    points = sampled(flared, 1.5e-3, 2e-4)
    made = standing_mesh(flared.vertices, flared.triangles, "can", points, points[:, 2] > 0.004)
    base = made.vertices[made.vertices[:, 2] == 0.0]
    assert np.linalg.norm(base[:, :2], axis=1).max() < 0.0325


def as_exact(body):
    """A mesh, with points on it; those near the support count as completed."""
    points = sampled(mesh := mesh_of(body), 1.5e-3, 2e-4)
    return mesh, points, points[:, 2] > 0.004


def test_a_cup_keeps_its_floor_and_a_lamp_its_thin_plate():
    wall = manifold3d.Manifold.cylinder(0.05, 0.03, 0.03, 24)
    cup = wall - manifold3d.Manifold.cylinder(0.05, 0.026, 0.026, 24).translate((0, 0, 0.004))
    lamp = manifold3d.Manifold.cylinder(0.003, 0.05, 0.05, 48) + manifold3d.Manifold.cylinder(0.05, 0.012, 0.012, 48)
    for body in (cup, lamp):
        mesh = mesh_of(body)
        made = standing_mesh(mesh.vertices, mesh.triangles)
        whole = Mesh(made.vertices, made.triangles)
        assert whole.volume == pytest.approx(mesh.volume, rel=0.05)
        assert area_at(whole, [0, 0, -1], 0.0) == pytest.approx(area_at(mesh, [0, 0, -1], 0.0), rel=0.05)
        assert not any("may roll" in note for note in made.notes)


def test_planes_that_leave_out_a_leg_do_not_explain_a_table():
    leg = manifold3d.Manifold.cube((0.012, 0.012, 0.045))
    legs = [leg.translate((x, y, 0.0)) for x in (-0.046, 0.034) for y in (-0.046, 0.034)]
    top = manifold3d.Manifold.cube((0.1, 0.1, 0.02)).translate((-0.05, -0.05, 0.04))
    mesh, points, seen = as_exact(manifold3d.Manifold.batch_boolean([top, *legs], manifold3d.OpType.Add))
    made = standing_mesh(mesh.vertices, mesh.triangles, "table", points, seen)
    whole = Mesh(made.vertices, made.triangles)
    np.testing.assert_allclose(whole.centroid, mesh.centroid, atol=3e-4)
    assert solid_of(whole).slice(1e-5).area() == pytest.approx(4 * 0.012**2, rel=0.1)


def test_points_that_coincide_or_lie_far_off_change_nothing():
    box = standing(Box((0.06, 0.05, 0.08)), 0.08)
    points = sampled(box, 1.5e-3, 2e-4)
    seen = np.ones(2 * len(points) + 200, bool)
    twice = np.concatenate([points, np.full((100, 3), 1e200), np.full((100, 3), np.nan), points])
    once = standing_mesh(box.vertices, box.triangles, "box", points, seen[: len(points)])
    again = standing_mesh(box.vertices, box.triangles, "box", twice, seen)
    np.testing.assert_array_equal(once.vertices, again.vertices)
    same = np.tile(points[points[:, 2] > 0.01][:1], (500, 1))
    assert faceted(solid_of(box), same, seen[:500], 0.004, 0.001) is None


def solid_of(mesh):
    return manifold3d.Manifold(manifold3d.Mesh64(np.asarray(mesh.vertices), np.asarray(mesh.triangles, np.uint64)))


def test_with_its_points_too_a_ball_does_not_stand_on_a_disc():
    vertices, triangles = ball(0.03)
    points = sampled(Mesh(vertices, triangles), 1.5e-3, 2e-4)
    made = standing_mesh(vertices, triangles, "ball", points, np.ones(len(points), bool))
    base = made.vertices[made.vertices[:, 2] == 0.0]
    assert np.linalg.norm(base[:, :2], axis=1).max() < 0.009
    assert "may roll" in made.notes[0]
    assert Mesh(made.vertices, made.triangles).volume == pytest.approx(4 / 3 * np.pi * 0.03**3, rel=0.04)


def test_what_planes_do_not_explain_keeps_its_surface():
    turns = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    wave = 0.03 + 0.005 * np.cos(20 * turns)
    gear = extruded(np.column_stack([wave * np.cos(turns), wave * np.sin(turns)]).tolist(), 0.05)
    points = sampled(gear, 1.5e-3, 1e-4)
    made = standing_mesh(gear.vertices, gear.triangles, "gear", points, np.ones(len(points), bool))
    assert Mesh(made.vertices, made.triangles).volume == pytest.approx(gear.volume, rel=0.05)


def test_parts_unite_without_the_faces_that_they_share():
    corners, triangles = united_surfaces(brick())
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert not np.any(np.unique(edges, axis=0, return_counts=True)[1] % 2)
    volume = Mesh(corners, triangles).volume
    assert volume == pytest.approx(sum(Mesh(*part).volume for part in brick()), rel=1e-3)


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
