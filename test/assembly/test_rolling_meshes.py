"""Meshes that stand for round bodies roll as these do; flat sides of other meshes stay flat."""

import assembly_scenes as scenes
import numpy as np
import pytest
import rolling_scenes as rolls
import shapely
import trimesh
from assembly_scenes import G
from rolling_scenes import R

from poise.assembly import Analysis, Mesh, RigidObject, acceleration_limits
from poise.assembly.scene import ROLLING
from poise.assembly.statics import rolling


def limits(assembly):
    return acceleration_limits(assembly, np.array([[1.0, 0, 0], [-1, 0, 0]]), turning=False).limits


def extruded(outline):
    return trimesh.creation.extrude_polygon(outline, 0.2)


@pytest.mark.parametrize("sides", [12, 32, 64, 180, 720])
def test_a_prism_of_many_sides_rolls_as_the_cylinder_that_it_stands_for(sides):
    """Its flat side would hold it up to tan(pi / sides): 0.27 g for 12, a hundred times too much for the cylinder."""
    assembly = rolls.prism(sides)
    found = acceleration_limits(assembly, 72, turning=False).limits
    assert found.min() == pytest.approx(ROLLING * G, rel=0.05)
    assert [each.objects for each in rolling(Analysis.of(assembly))] == [("body",)]


def test_a_prism_of_eight_sides_is_flat():
    found = acceleration_limits(rolls.prism(8), 360, turning=False).limits
    assert found.min() == pytest.approx(np.tan(np.pi / 8) * G, rel=1e-3)
    assert not rolling(Analysis.of(rolls.prism(8)))


BALLS = {
    "icosphere of 80": trimesh.creation.icosphere(1, R),
    "icosphere of 1280": trimesh.creation.icosphere(3, R),
    "meridians": trimesh.creation.uv_sphere(R, [32, 32]),
}


@pytest.mark.parametrize("name", BALLS)
@pytest.mark.parametrize("facet", [0, 7, 60])
def test_a_mesh_of_a_ball_rolls_every_way_whatever_facet_it_lies_on(name, facet):
    surface = BALLS[name]
    found = limits(rolls.mesh_on_floor(surface, surface.face_normals[facet]))
    assert found == pytest.approx(ROLLING * G, rel=0.2)


def test_a_cone_rolls_at_the_radius_under_its_centre_of_mass():
    surface = trimesh.creation.cone(radius=R, height=0.15, sections=64)
    side = int(np.argmax(np.where(surface.face_normals[:, 2] > -0.5, surface.area_faces, 0)))
    assembly = rolls.mesh_on_floor(surface, surface.face_normals[side])
    found = acceleration_limits(assembly, 360, turning=False).limits.min()
    # Along a side, three quarters of the way from the tip, the centre of mass is h sin(half angle) above the floor, and
    # the edges of the region in which the contact force acts are there R cos / cos away, per coefficient.
    half = np.arctan(R / 0.15)
    height, radius = 0.75 * 0.15 * np.sin(half), 0.75 * 0.15 * np.cos(half) ** 2 / 0.15 * R / np.cos(half)
    assert found == pytest.approx(ROLLING * G * radius / height, rel=0.03)


FLAT = {
    "rounded edges": extruded(shapely.box(-0.04, -0.04, 0.04, 0.04).buffer(0.01, quad_segs=8)),
    "a flat on a bar": extruded(
        shapely.Point(0, 0).buffer(R, quad_segs=16).intersection(shapely.box(-1, -0.9 * R, 1, 1))
    ),
}


@pytest.mark.parametrize("name", FLAT)
def test_flat_sides_between_round_ones_hold(name):
    assembly = rolls.mesh_on_floor(FLAT[name], [0, -1, 0])
    assert Analysis.of(assembly).structure.interfaces[0].area > 1e-3
    assert not rolling(Analysis.of(assembly))


def test_a_mesh_whose_mass_is_off_its_axis_by_more_than_a_facet_does_not_stand():
    surface = trimesh.creation.cylinder(radius=R, height=0.2, sections=64)
    down = np.array([np.cos(np.pi / 64), np.sin(np.pi / 64), 0])
    touch = Analysis.of(rolls.mesh_on_floor(surface, down)).structure.interfaces[0].touch
    for off, stands in ((0.02 * R, True), (0.2 * R, False)):
        analysis = Analysis.of(rolls.mesh_on_floor(surface, down, com=off * touch.across))
        assert analysis.stability().stable == stands


def test_a_mesh_can_between_chocks_is_held_and_a_box_on_a_fixed_mesh_pipe_rocks():
    mesh = rolls.prism(64).objects[1]
    between = scenes.on_floor(mesh, *turned_chocks(mesh))
    assert limits(between).min() > 0.5 * G
    pipe = RigidObject("pipe", mesh.shape, mesh.pose, fixed=True)
    top = float(mesh.vertices[:, 2].max())
    on = scenes.on_floor(pipe, scenes.box("plank", (0.1, 0.1, 0.02), (0, 0, top + 0.01)))
    assert [(each.objects, each.equilibrium) for each in rolling(Analysis.of(on))] == [(("plank",), "stable")]


def turned_chocks(mesh):
    """Chocks as high as the axis, whichever way the mesh lies, as upright walls."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return [
        scenes.fixed_box(f"{axis}{side}", (0.02, 1, R) if axis == 0 else (1, 0.02, R), middle)
        for axis in (0, 1)
        for side, edge in ((-1, low[axis] - 0.01), (1, high[axis] + 0.01))
        for middle in ((edge, 0, R / 2) if axis == 0 else (0, edge, R / 2),)
    ]


def test_a_rigid_cart_on_two_wheels_in_one_mesh_does_not_roll():
    wheels = [trimesh.creation.cylinder(radius=R, height=0.1, sections=64) for _ in range(2)]
    for wheel, x in zip(wheels, (-0.15, 0.15), strict=True):
        wheel.apply_translation([x, 0, 0])
    beam = trimesh.creation.box([0.3, 0.02, 0.06])
    cart = trimesh.boolean.union([*wheels, beam], engine="manifold")
    cart.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    mesh = Mesh(np.asarray(cart.vertices), np.asarray(cart.faces, dtype=np.int64))
    assembly = scenes.on_floor(
        RigidObject("cart", mesh, scenes.pose((0, 0, -float(mesh.vertices[:, 2].min()))), mass=1.0)
    )
    assert limits(assembly).min() == pytest.approx(0.5 * G, rel=0.01)


@pytest.mark.parametrize("axes", [(1.0, 1.0, 1.5), (1.5, 1.25, 1.0), (2.0, 1.5, 0.5)])
def test_an_egg_rolls_and_is_not_held_by_its_facets(axes):
    """Its radii differ by direction: its facets were flat, and held it up to 0.07 g without a word."""
    surface = trimesh.creation.icosphere(3, R).apply_scale(axes)
    least = np.zeros(3)
    least[np.argmin(axes)] = -1.0
    down = surface.face_normals[int(np.argmax(surface.face_normals @ least))]  # as it comes to rest
    assembly = rolls.mesh_on_floor(surface, down)
    found = acceleration_limits(assembly, 36, turning=False).limits
    # The contact force may act `rolling` radii ahead, at most those of the flattest direction.
    assert found.max() < 1.3 * ROLLING * G * max(axes) ** 2 / min(axes) ** 2
    (rolls_there,) = rolling(Analysis.of(assembly))
    if axes == (2.0, 1.5, 0.5):  # both radii under it are larger than its height: a pebble rocks
        assert rolls_there.equilibrium == "stable"


def _around(share):
    """Outwards of a prism of 32 sides, turned from a facet by a share of the angle to the next one."""
    angle = (share + 0.5) * 2 * np.pi / 32
    return np.array([np.cos(angle), np.sin(angle), 0.0])


ROUND = {
    "prism": trimesh.creation.cylinder(radius=R, height=0.2, sections=32),
    "capsule": trimesh.creation.capsule(0.2, R, [32, 32]),
    "cone": trimesh.creation.cone(radius=R, height=0.15, sections=32),
    "ball": trimesh.creation.icosphere(2, R),
}
ON_EDGES = {
    **{f"{name} {share}": (name, _around(share)) for name in ("prism", "capsule") for share in (0.3, 0.5, 0.8)},
    "cone": ("cone", np.array([np.cos(np.arctan(R / 0.15)), 0.0, np.sin(np.arctan(R / 0.15))])),
    "ball, on an edge": ("ball", ROUND["ball"].vertices[ROUND["ball"].edges_unique[40]].sum(axis=0)),
    "ball, on a vertex": ("ball", ROUND["ball"].vertices[40]),
}


@pytest.mark.parametrize("case", ON_EDGES)
def test_a_round_side_that_lies_on_an_edge_between_its_facets_rolls_there(case):
    """A flat side would tip from there."""
    name, down = ON_EDGES[case]
    assembly = rolls.mesh_on_floor(ROUND[name], down / np.linalg.norm(down))
    analysis = Analysis.of(assembly)
    assert analysis.stability().stable
    assert [each.objects for each in rolling(analysis)] == [("body",)]
    assert acceleration_limits(assembly, 72, turning=False).limits.min() == pytest.approx(ROLLING * G, rel=0.2)
