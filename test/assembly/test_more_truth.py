"""More statics with known answers: slopes, wedges, hooks, ceilings, lying cylinders, nested cups, leaning pairs."""

import assembly_scenes as scenes
import numpy as np
import pytest
import shapely
from assembly_scenes import G, box, fixed_box

from poise.assembly import Assembly, Mesh, Push, RigidObject, assess
from poise.assembly.scene import ROLLING

EXACT = 1e-6
MODELS = ("limit", "default")


def robustness(assembly, name, point, direction, model="default"):
    return assess(assembly, [Push(name, point, direction)], model).results[0].robustness


def prism(name, corners, half_width, fixed=False, **more):
    """A body of constant cross-section: corners (x, z) of a quadrilateral, counter-clockwise seen from -y."""
    ends = [(x, -half_width, z) for x, z in corners] + [(x, half_width, z) for x, z in corners]
    mesh = scenes.shells(scenes.hexahedron(ends))
    return RigidObject(name, mesh, scenes.pose((0, 0, 0)), fixed=fixed, mass=0.0 if fixed else 1.0, **more)


def tilted(assembly, degrees, axis=0):
    """The same assembly on a tray whose side towards +axis is lowered."""
    angle = np.radians(degrees)
    gravity = np.array([0.0, 0.0, -G * np.cos(angle)])
    gravity[axis] = G * np.sin(angle)
    return Assembly(assembly.objects, gravity, assembly.friction, assembly.friction_pairs)


@pytest.mark.parametrize("model", MODELS)
def test_on_a_slope_a_cube_slides_by_what_its_weight_leaves_of_friction(model):
    """Down, up and across the slope; pushed at the base, across in line with its centre of pressure."""
    mu, angle = 0.6, np.radians(20)
    assembly = tilted(scenes.cube(mu), 20)
    pressed, pulled = mu * G * np.cos(angle), G * np.sin(angle)
    shift = 0.5 * np.tan(angle)
    assert robustness(assembly, "cube", (-0.5, 0, 0), (1, 0, 0), model) == pytest.approx(pressed - pulled, rel=EXACT)
    assert robustness(assembly, "cube", (0.5, 0, 0), (-1, 0, 0), model) == pytest.approx(pressed + pulled, rel=EXACT)
    across = np.sqrt(pressed**2 - pulled**2)
    found = robustness(assembly, "cube", (shift, -0.5, 0), (0, 1, 0), model)
    assert found == pytest.approx(across, rel=EXACT if model == "limit" else 0.005)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_stack_on_a_tilted_tray_topples_at_its_weakest_edge(model, place):
    """Of the k upper cubes, weight k W at height k / 2 over an edge: k W (cos / 2 - k sin / 2) against F z."""
    angle = np.radians(8)
    assembly = tilted(scenes.stack(3, friction=0.95), 8)
    height = place + 1.0
    edges = [(3 - i) * G * (np.cos(angle) / 2 - (3 - i) * np.sin(angle) / 2) / (height - i) for i in range(place + 1)]
    found = robustness(assembly, f"c{place}", (-0.5, 0, height), (1, 0, 0), model)
    assert found == pytest.approx(min(edges), rel=EXACT)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("offset", [-0.3, 0.2])
def test_an_off_centre_mass_topples_at_its_own_lever(model, offset):
    assembly = scenes.cube(0.95, com=np.array([offset, 0.0, -0.2]))
    found = robustness(assembly, "cube", (-0.5, 0, 1), (1, 0, 0), model)
    assert found == pytest.approx(G * (0.5 - offset), rel=EXACT)


@pytest.mark.parametrize("model", ["limit", "patch"])
@pytest.mark.parametrize("degrees", [10, 20])
def test_a_wedge_driven_under_a_guided_block_lifts_it_by_the_classical_force(model, degrees):
    """Friction angle f, slope t: the wedge presses the block by W cos(f) / cos(t + 2 f) at t + f from the vertical."""
    mu, angle = 0.25, np.radians(degrees)
    phi, rise = np.arctan(mu), np.tan(angle)
    # The slope rises to the right: driven to the left it lifts the block, which a wall on the left keeps in place.
    wedge = prism("wedge", [(-1.5, 0), (1.5, 0), (1.5, 0.3 + 3 * rise), (-1.5, 0.3)], 0.5)
    low, high = 0.3 + rise, 0.3 + 2 * rise
    block = prism("block", [(-0.5, low), (0.5, high), (0.5, high + 1), (-0.5, high + 1)], 0.5)
    wall = fixed_box("wall", (0.2, 4, 4), (-0.6, 0, low + 2.2))
    assembly = Assembly((scenes.FLOOR, wall, wedge, block), scenes.GRAVITY, mu)
    on_block = G * np.cos(phi) / np.cos(angle + 2 * phi)
    expected = on_block * np.sin(angle + phi) + mu * (G + on_block * np.cos(angle + phi))
    found = robustness(assembly, "wedge", (1.5, 0, 0.1), (-1, 0, 0), model)
    assert found == pytest.approx(expected, rel=EXACT if model == "limit" else 0.005)


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_two_slabs_lean_on_each_other_when_friction_exceeds_half_the_cotangent(share):
    """Thrust H = W / (2 h) for feet 1 m from the top line and height h: the floor must hold mu W."""
    height, tip = 1.2, 0.01
    mu = share / (2 * height)
    left = prism(
        "left", [(-1, 0), (-0.99, 0), (0, height - tip), (0, height)], 0.5, com=np.array([-0.5, 0, height / 2])
    )
    right = prism("right", [(0.99, 0), (1, 0), (0, height), (0, height - tip)], 0.5, com=np.array([0.5, 0, height / 2]))
    found = assess(scenes.on_floor(left, right, friction=mu), [])
    assert found.stable is (share > 1)


def test_a_block_under_a_ceiling_slides_by_its_weight_alone_though_limit_analysis_would_jam_it():
    ceiling = fixed_box("ceiling", (3, 3, 0.1), (0, 0, 1.05))
    assembly = Assembly((scenes.FLOOR, ceiling, box("cube", (1, 1, 1), (0, 0, 0.5))), scenes.GRAVITY, 0.5)
    assert robustness(assembly, "cube", (-0.5, 0, 0.05), (1, 0, 0), "limit") == np.inf
    assert robustness(assembly, "cube", (-0.5, 0, 0.05), (1, 0, 0)) == pytest.approx(0.5 * G, rel=0.02)
    assert robustness(assembly, "cube", (0, 0, 0), (0, 0, 1)) == np.inf


def test_a_hook_under_a_bar_cannot_be_pulled_up_and_slides_along_it():
    """A C-shaped body, its lower jaw under a fixed beam, its upper one resting on it."""
    beam = fixed_box("beam", (4, 0.4, 0.2), (0, 0, 1))
    outline = [(-0.2, 0.7), (0.4, 0.7), (0.4, 1.3), (-0.2, 1.3), (-0.2, 1.1), (0.2, 1.1), (0.2, 0.9), (-0.2, 0.9)]
    hook = RigidObject("hook", extruded(outline, 0.5), scenes.pose((0, 0, 0)), mass=1.0, com=np.array([0, 0, 1.0]))
    assembly = Assembly((beam, hook), scenes.GRAVITY, 0.3)
    assert robustness(assembly, "hook", (0, 0, 1.3), (0, 0, 1)) == np.inf
    assert robustness(assembly, "hook", (-0.5, 0, 1.1), (1, 0, 0)) == pytest.approx(0.3 * G, rel=0.02)


def extruded(outline, half):
    """A mesh of an outline (y, z), counter-clockwise, extruded to both sides along x."""
    turn = np.array([[x, y, z] for x in (-half, half) for y, z in outline])
    count = len(outline)
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(outline)))
    corners = [shapely.get_coordinates(shapely.normalize(part))[2::-1] for part in parts]
    caps = [[int(np.abs(np.array(outline) - corner).sum(axis=1).argmin()) for corner in part] for part in corners]
    caps = [cap if _turns_left(outline, cap) else cap[::-1] for cap in caps]
    k = np.arange(count)
    after = (k + 1) % count
    sides = [*zip(k, k + count, after + count, strict=True), *zip(k, after + count, after, strict=True)]
    faces = [cap[::-1] for cap in caps] + [[i + count for i in cap] for cap in caps] + [side[::-1] for side in sides]
    return Mesh(turn, np.array(faces))


def _turns_left(outline, cap):
    (a, b), (c, d), (e, f) = (outline[i] for i in cap)
    return (c - a) * (f - b) - (d - b) * (e - a) > 0


@pytest.mark.parametrize("model", MODELS)
def test_a_lying_cylinder_rolls_at_a_touch_and_slides_along_its_axis(model):
    lying = scenes.cylinder("roll", 0.3, 1.0, (0, 0, 0.3), quaternion=scenes.turned((1, 0, 0), 90))
    assembly = scenes.on_floor(lying, friction=0.4)
    assert assess(assembly, []).stable
    rolls = robustness(assembly, "roll", (-0.3, 0, 0.3), (1, 0, 0), model)
    assert rolls == pytest.approx(ROLLING * G, rel=EXACT)
    assert robustness(assembly, "roll", (0, -0.5, 0.01), (0, 1, 0), model) == pytest.approx(0.4 * G, rel=EXACT)


def cup(name, radius, height, thickness, position, sides=16, **more):
    """A body bounded by two nested cones (frustums) of 45 degrees, open at the top."""
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def loop(r, z):
        return np.column_stack([r * ring, np.full(sides, z)])

    lift = thickness * np.sqrt(2)
    rows = [
        loop(radius, 0),
        loop(radius + height, height),
        loop(radius + height - lift, height),
        loop(radius, lift),
    ]
    vertices = np.concatenate([*rows, [[0, 0, 0], [0, 0, lift]]])
    faces = []
    k = np.arange(sides)
    after = (k + 1) % sides
    for low, high in ((0, 1), (1, 2), (2, 3)):
        faces += [*zip(low * sides + k, low * sides + after, high * sides + after, strict=True)]
        faces += [*zip(low * sides + k, high * sides + after, high * sides + k, strict=True)]
    faces += [*zip(after, k, np.full(sides, 4 * sides), strict=True)]
    faces += [*zip(3 * sides + k, 3 * sides + after, np.full(sides, 4 * sides + 1), strict=True)]
    return RigidObject(name, Mesh(vertices, np.array(faces)), scenes.pose(position), mass=1.0, **more)


def test_nested_cups_lift_out_of_each_other_by_their_weight():
    lift = 0.02 * np.sqrt(2)
    outer = cup("outer", 0.1, 0.1, 0.02, (0, 0, 0))
    inner = cup("inner", 0.1, 0.1, 0.02, (0, 0, lift))
    assembly = scenes.on_floor(outer, inner, friction=0.3)
    assert robustness(assembly, "inner", (0, 0, 2 * lift), (0, 0, 1)) == pytest.approx(G, rel=0.02)
    assert robustness(assembly, "outer", (0, 0, 0), (0, 0, 1)) == pytest.approx(2 * G, rel=0.02)
