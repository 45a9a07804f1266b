"""Where bodies touch: areas, lines and points by hand; gaps, overlaps and things that only seem to touch."""

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import FLOOR, box, fixed_box, on_floor, turned
from scipy.spatial.transform import Rotation

from poise.assembly import Assembly, Mesh, Push, RigidObject, assess
from poise.assembly.contact.contacts import CONTACT_MARGIN, find_interfaces
from poise.assembly.contact.graph import Structure
from poise.assembly.contact.placed import PlacedBody, triangle_areas
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose


def only(assembly):
    found = find_interfaces(assembly)
    assert len(found) == 1, found
    return found[0]


def test_a_box_on_a_floor_touches_with_its_whole_face():
    found = only(scenes.cube())
    assert found.area == pytest.approx(1)
    assert len(found.points) == 4
    np.testing.assert_allclose(found.normal, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(found.points[:, 2], 0, atol=1e-12)
    assert {tuple(p) for p in np.round(np.abs(found.points[:, :2]), 12)} == {(0.5, 0.5)}


def test_two_crossed_boxes_touch_where_they_overlap():
    lower = box("lower", (2, 1, 0.2), (0, 0, 0.1))
    upper = box("upper", (2, 1, 0.2), (0, 0, 0.3), quaternion=turned((0, 0, 1), 90))
    found = [i for i in find_interfaces(on_floor(lower, upper)) if i.first > 0]
    assert len(found) == 1
    assert found[0].area == pytest.approx(1)


@pytest.mark.parametrize("gap", [1e-3, -1e-3, 0.0])
def test_gaps_and_overlaps_of_a_millimetre_are_touch_and_are_reported(gap):
    found = only(on_floor(box("cube", (1, 1, 1), (0, 0, 0.5 + gap))))
    assert found.gap == pytest.approx(gap, abs=1e-12)
    assert found.area == pytest.approx(1)
    np.testing.assert_allclose(found.points[:, 2], gap / 2, atol=1e-12)


def test_beyond_the_margin_nothing_touches_and_the_object_floats():
    cube = box("cube", (1, 1, 1), (0, 0, 0.5 + CONTACT_MARGIN + 1e-4))
    with pytest.raises(InputError, match="nothing holds cube") as caught:
        Structure.of(on_floor(cube))
    assert caught.value.code is ErrorCode.FLOATING
    assert caught.value.data["objects"] == ["cube"]


def test_a_slight_lean_of_a_scan_still_lies_flat():
    cube = box("cube", (1, 1, 1), (0, 0, 0.5005), quaternion=turned((1, 0, 0), 0.05))
    assert only(on_floor(cube)).area == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize("depth", [2e-3, 0.1])
def test_deeper_overlap_is_refused_with_both_names_and_the_depth(depth):
    with pytest.raises(InputError, match="floor and cube overlap") as caught:
        find_interfaces(on_floor(box("cube", (1, 1, 1), (0, 0, 0.5 - depth))))
    assert caught.value.code is ErrorCode.INTERPENETRATION
    assert caught.value.data["depth"] == pytest.approx(depth, rel=1e-3)


def test_a_mesh_inside_a_notched_mesh_is_overlap_only_where_there_is_matter():
    """A U-shaped body: a block between its arms is fine, a block in an arm is not."""
    parts = [((-1, -1), (1, -0.8)), ((-1, -0.8), (-0.8, 1)), ((0.8, -0.8), (1, 1))]
    shells = []
    for (x0, z0), (x1, z1) in parts:
        square = [(x0, -0.5), (x1, -0.5), (x1, 0.5), (x0, 0.5)]
        shells.append(scenes.hexahedron([(x, y, z0) for x, y in square] + [(x, y, z1) for x, y in square]))
    cup = RigidObject("cup", scenes.shells(*shells), scenes.pose((0, 0, 1)), mass=1)
    inside = on_floor(cup, box("inside", (0.4, 0.4, 0.4), (0, 0, 0.4)))
    touch = [i for i in find_interfaces(inside) if i.first > 0]
    assert len(touch) == 1
    assert touch[0].area == pytest.approx(0.16)
    with pytest.raises(InputError, match="overlap"):
        find_interfaces(on_floor(cup, box("inside", (0.4, 0.4, 0.4), (0.75, 0, 0.9))))


def test_blocks_that_share_only_an_edge_do_not_press_on_each_other():
    found = find_interfaces(on_floor(box("a", (1, 1, 1), (0, 0, 0.5)), box("b", (1, 1, 1), (1, 1, 0.5))))
    assert [(i.first, i.second) for i in found] == [(0, 1), (0, 2)]


def test_a_box_on_its_edge_touches_along_a_line():
    found = only(on_floor(box("roof", (2, 1, 1), (0, 0, np.sqrt(0.5)), quaternion=turned((1, 0, 0), 45))))
    assert found.area == 0
    np.testing.assert_allclose(sorted(found.points[:, 0]), [-1, 1], atol=1e-9)


def test_a_plank_leaning_on_a_block_as_wide_touches_along_a_line_at_both_ends():
    assembly, _ = scenes.ladder()
    narrow = fixed_box("wall", (0.1, 0.5, 10), (assembly.objects[1].pose.translation[0], 0, 5))
    found = find_interfaces(Assembly((FLOOR, narrow, assembly.objects[2]), scenes.GRAVITY))
    assert [len(i.points) for i in found] == [2, 2]
    for interface in found:
        np.testing.assert_allclose(np.ptp(interface.points[:, 1]), 0.5, atol=1e-9)
    np.testing.assert_allclose(np.abs(found[1].normal), [1, 0, 0], atol=1e-9)


def test_three_spikes_are_one_interface_with_a_triangle_of_points():
    found = only(scenes.tripod(0.5))
    assert found.area == 0
    assert len(found.points) == 3
    np.testing.assert_allclose(np.linalg.norm(found.points[:, :2], axis=1), 0.5, atol=1e-9)


def test_saw_teeth_on_a_floor_touch_along_parallel_lines():
    teeth = []
    for i in range(3):
        ridge = [(i, 0.0), (i + 0.4, 0.5), (i - 0.4, 0.5)]
        ends = [[(x, y, z) for x, z in ridge] for y in (-0.5, 0.5)]
        triangles = [(0, 1, 2), (3, 5, 4), (0, 4, 1), (0, 3, 4), (1, 5, 2), (1, 4, 5), (2, 3, 0), (2, 5, 3)]
        teeth.append((ends[0] + ends[1], triangles))
    found = only(on_floor(RigidObject("saw", scenes.shells(*teeth), scenes.pose((0, 0, 0)), mass=1)))
    assert found.area == 0
    corners = {(round(float(x), 6), round(float(y), 6)) for x, y, _ in found.points}
    assert corners == {(0, -0.5), (0, 0.5), (2, -0.5), (2, 0.5)}


def test_crossed_rods_touch_at_a_point_across_their_edges():
    half = 0.1 * np.sqrt(0.5)
    lower = fixed_box("lower", (2, 0.1, 0.1), (0, 0, 0), turned((1, 0, 0), 45))
    lean = Rotation.from_euler("z", 90, degrees=True) * Rotation.from_euler("x", 45, degrees=True)
    upper = box("upper", (2, 0.1, 0.1), (0, 0, 2 * half), quaternion=lean.as_quat())
    found = only(Assembly((lower, upper), scenes.GRAVITY))
    np.testing.assert_allclose(found.points, [[0, 0, half]], atol=1e-9)
    np.testing.assert_allclose(found.normal, [0, 0, 1], atol=1e-9)


@pytest.mark.parametrize(
    ("position", "quaternion", "points"),
    [
        ((0, 0, 0.25), (0, 0, 0, 1), 64),
        ((0, 0, 0.1), turned((0, 1, 0), 90), 2),
        ((0, 0, 0.25 * np.cos(0.5) + 0.1 * np.sin(0.5)), turned((0, 1, 0), np.degrees(0.5)), 1),
    ],
    ids=["standing", "lying", "on its rim"],
)
def test_a_cylinder_touches_a_floor_on_a_disc_a_line_or_a_point(position, quaternion, points):
    found = only(on_floor(scenes.cylinder("can", 0.1, 0.5, position, quaternion=quaternion)))
    touch = found.points if found.touch is None else found.touch.points
    assert len(touch) == points
    np.testing.assert_allclose(found.points[:, 2], 0, atol=1e-9)
    assert found.area == pytest.approx(np.pi * 0.01 if points == 64 else 0, rel=2e-3)


def test_cylinders_touch_each_other_along_a_line_when_parallel_and_at_a_point_when_crossed():
    lying = turned((0, 1, 0), 90)
    ground = fixed_box("ground", (4, 4, 0.1), (0, 0, -0.05))
    lower = RigidObject("lower", scenes.Cylinder(0.1, 1.0), scenes.pose((0, 0, 0.1), lying), fixed=True)
    along = scenes.cylinder("along", 0.1, 0.6, (0.4, 0, 0.3), quaternion=lying)
    across = scenes.cylinder("across", 0.1, 0.6, (0, 0, 0.3), quaternion=turned((1, 0, 0), 90))
    line = only(Assembly((ground, lower, along), scenes.GRAVITY))
    np.testing.assert_allclose(sorted(line.touch.points[:, 0]), [0.1, 0.5], atol=1e-9)
    point = only(Assembly((ground, lower, across), scenes.GRAVITY))
    np.testing.assert_allclose(point.touch.points, [[0, 0, 0.2]], atol=1e-9)


def test_a_cylinder_across_an_edge_touches_it_at_a_point():
    ridge = fixed_box("ridge", (0.2, 2, 0.2), (0, 0, -0.1 * np.sqrt(2)), turned((0, 1, 0), 45))
    roll = scenes.cylinder("roll", 0.1, 1.0, (0, 0, 0.1), quaternion=turned((0, 1, 0), 90))
    found = only(Assembly((ridge, roll), scenes.GRAVITY))
    np.testing.assert_allclose(found.touch.points, [[0, 0, 0]], atol=1e-9)


def test_contacts_turn_with_the_scene():
    rng = np.random.default_rng(1)
    still = find_interfaces(scenes.wall(3, 3))
    for _ in range(3):
        turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
        objects = []
        for item in scenes.wall(3, 3).objects:
            pose = Pose(turn @ item.pose.rotation, turn @ item.pose.translation + shift)
            objects.append(RigidObject(item.id, item.shape, pose, item.fixed, item.mass))
        moved = find_interfaces(Assembly(tuple(objects), scenes.GRAVITY))
        assert [(i.first, i.second) for i in moved] == [(i.first, i.second) for i in still]
        np.testing.assert_allclose([i.area for i in moved], [i.area for i in still], rtol=1e-6)
        np.testing.assert_allclose([i.normal for i in moved], [turn @ i.normal for i in still], atol=1e-9)


def test_facets_of_a_box_close_around_its_volume():
    body = PlacedBody(box("b", (1, 2, 3), (4, 5, 6), quaternion=turned((1, 2, 3), 40)))
    assert triangle_areas(body.vertices[body.polyhedron.triangles]).sum() == pytest.approx(22)
    heights = np.einsum("vfk,fk->vf", body.vertices[:, None] - body.origins, body.normals)
    assert heights.max() < 1e-9


def test_a_thin_object_touches_within_half_its_thickness():
    """1.5 mm of a sheet of 1 mm would reach through it, and from a grain of 2 mm to the next one."""
    for height, code in ((1.7e-3, ErrorCode.FLOATING), (-0.2e-3, ErrorCode.INTERPENETRATION)):
        with pytest.raises(InputError, match=r"0.5 mm") as error:
            Structure.of(on_floor(box("sheet", (0.2, 0.2, 0.001), (0, 0, height))))
        assert error.value.code == code
    assert only(on_floor(box("sheet", (0.2, 0.2, 0.001), (0, 0, 0.9e-3)))).gap == pytest.approx(0.4e-3)
    grains = [box(name, (0.002,) * 3, (x, 0, 0.001), mass=1e-5) for name, x in (("a", 0.0), ("b", 0.0034))]
    assert {(each.first, each.second) for each in find_interfaces(on_floor(*grains))} == {(0, 1), (0, 2)}
    tray = shells_of_tray(0.001)
    assert RigidObject("tray", tray, Pose.identity(), mass=0.1).shape.polyhedron.thickness < 0.0011


def shells_of_tray(wall):
    """A tray of sheet metal: two boxes, one in the other, open at the top."""
    outer, inner = np.array([0.3, 0.2, 0.03]), np.array([0.3, 0.2, 0.03]) - [2 * wall, 2 * wall, wall]
    corners = np.array([[x, y] for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))])
    low, high = np.c_[corners * outer[:2], np.zeros(4)], np.c_[corners * outer[:2], np.full(4, outer[2])]
    rim, bottom = np.c_[corners * inner[:2], np.full(4, outer[2])], np.c_[corners * inner[:2], np.full(4, wall)]
    quads = [[3, 2, 1, 0], [12, 13, 14, 15]]
    for i in range(4):
        j = (i + 1) % 4
        quads += [[i, j, 4 + j, 4 + i], [4 + i, 4 + j, 8 + j, 8 + i], [8 + i, 8 + j, 12 + j, 12 + i]]
    triangles = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return Mesh(np.concatenate([low, high, rim, bottom]), np.array(triangles))


def test_objects_do_not_touch_through_what_lies_between_them():
    """A cup on five sheets of paper presses on the topmost, and a sheet slides with all that is above it."""
    sheets = [box(f"s{i}", (0.21, 0.297, 1e-4), (0, 0, (i + 0.5) * 1e-4), mass=0.005) for i in range(5)]
    stack = on_floor(*sheets, box("cup", (0.08, 0.08, 0.1), (0, 0, 0.0505), mass=0.3))
    assert {(each.first, each.second) for each in find_interfaces(stack)} == {(i, i + 1) for i in range(6)}
    found = assess(stack, [Push("s2", (-0.105, 0, 2.5e-4), (1, 0, 0))]).results[0]
    assert found.robustness == pytest.approx(0.5 * 0.315 * 9.81, rel=1e-3)
    assert found.moves == ("s2", "s3", "s4", "cup")
    # What fills a part of the gap only, as a shim under a plate, takes no contact away.
    shim = box("shim", (0.05, 0.05, 1e-3), (0.1, 0, 0.5e-3))
    pairs = {
        (each.first, each.second) for each in find_interfaces(on_floor(shim, box("p", (0.4, 0.4, 0.02), (0, 0, 0.011))))
    }
    assert pairs == {(0, 1), (0, 2), (1, 2)}
