"""How fast a base may accelerate, turn and tilt: closed forms, the thesis' slant, and the polytope around it all."""

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import FLOOR, G, box, on_floor

from poise.assembly import Analysis, Assembly, RigidObject, acceleration_limits
from poise.assembly.robustness.elastic_limits import inertial_loads
from poise.assembly.robustness.gravity_cone import GravityCone
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose


def slant(mu=1.2):
    """A cube on a wedge that rises towards +y with tan a = 1/2, on a floor (thesis Fig. 4.16a)."""
    angle = np.arctan(0.5)
    square = [(-1, -1.5), (1, -1.5), (1, 1.5), (-1, 1.5)]
    top = [0.2, 0.2, 1.7, 1.7]
    corners = [(x, y, 0) for x, y in square] + [(x, y, z) for (x, y), z in zip(square, top, strict=True)]
    wedge = RigidObject("wedge", scenes.shells(scenes.hexahedron(corners)), scenes.pose((0, 0, 0)), mass=10)
    normal = np.array([0, -np.sin(angle), np.cos(angle)])
    quaternion = scenes.turned((1, 0, 0), np.degrees(angle))
    cube = box("cube", (0.5, 0.5, 0.5), np.array([0, 0, 0.95]) + 0.25 * normal, quaternion=quaternion)
    return on_floor(wedge, cube, friction=mu)


def test_the_slant_of_the_thesis_tips_at_3_27_and_slides_at_11_77():
    found = acceleration_limits(slant(), np.array([[0.0, 1, 0], [0, -1, 0]]))
    np.testing.assert_allclose(found.limits, [3.27, 11.77], rtol=1e-3)
    assert found.first_to_move == (("cube",), ("wedge", "cube"))


@pytest.mark.parametrize("width", [0.2, 0.5, 2.0])
@pytest.mark.parametrize("friction", [0.3, 0.8])
@pytest.mark.parametrize("rise", [-3.0, 0.0, 5.0])
def test_a_block_bears_g_plus_rise_times_the_lesser_of_friction_and_slenderness(width, friction, rise):
    """An acceleration (a, 0, rise): the block holds while a <= (g + rise) min(mu, width / height)."""
    block = on_floor(box("block", (width, 1, 1), (0, 0, 0.5)), friction=friction)
    lesser = min(friction, width)
    bound = (G + rise) * lesser
    direction = np.array([[bound, 0, rise]])
    found = acceleration_limits(block, direction)
    assert found.limits[0] == pytest.approx(np.linalg.norm(direction), rel=1e-6)


@pytest.mark.parametrize("degrees", [0.0, 20.0, 40.0])
def test_at_the_edge_of_friction_nothing_accelerates_away_from_it(degrees):
    """Without friction, or on a slope of the angle of friction, a limit down the slope is 0, not that of tipping."""
    slope = np.radians(degrees)
    cube = scenes.cube(friction=float(np.tan(slope)))
    tilted = Assembly(cube.objects, G * np.array([np.sin(slope), 0.0, -np.cos(slope)]), cube.friction)
    cone = GravityCone(*single_interface(tilted))
    (down, up), slips = cone.factors(tilted.gravity, np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]))
    assert down == pytest.approx(0, abs=1e-6)
    # Up the slope: g sin - s = -mu g cos.
    assert up == pytest.approx(2 * G * np.sin(slope), rel=1e-6, abs=1e-6)
    assert slips.all()


def single_interface(assembly):
    """What `GravityCone` takes of a scene with one object."""
    (block,) = Analysis.of(assembly).blocks
    (movable,) = (item for item in assembly.objects if not item.fixed)
    return block.interfaces[0], block.block.supports[0][1] == 0, movable.com_in_world


def test_accelerating_upward_is_sustained_for_ever_and_falling_until_gravity_is_gone():
    found = acceleration_limits(scenes.cube(), np.array([[0.0, 0, 1], [0, 0, -1]]))
    assert found.limits[0] == np.inf
    assert found.limits[1] == pytest.approx(G)


@pytest.mark.parametrize("scene", [scenes.cube, lambda: scenes.stack(4), slant], ids=["cube", "stack", "slant"])
def test_the_closed_cone_of_single_interfaces_is_what_limit_analysis_solves(scene):
    analysis = Analysis.of(scene())
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(25, 3))
    found = acceleration_limits(analysis, directions, turning=False)
    for direction, limit in zip(found.directions, found.limits, strict=True):
        inverses = [
            block.solvers.limit.inverse_factor(inertial_loads(block) @ direction).value for block in analysis.blocks
        ]
        solved = 1 / max(inverses) if max(inverses) > 1e-5 else np.inf
        assert limit == pytest.approx(solved, rel=1e-5)


def test_a_block_with_cycles_is_limited_by_limit_analysis_and_holds_nearly_as_much():
    analysis = Analysis.of(scenes.table())
    block = analysis.blocks[0]
    found = acceleration_limits(analysis, 24, turning=False)
    for direction, limit in zip(found.directions, found.limits, strict=True):
        solved = 1 / block.solvers.limit.inverse_factor(inertial_loads(block) @ direction).value
        assert limit <= solved * (1 + 1e-3)
        assert limit >= solved * 0.95  # patches may turn earlier


@pytest.mark.parametrize("scene", [scenes.cube, scenes.table, slant], ids=["cube", "table", "slant"])
def test_every_acceleration_in_the_polytope_is_sustained(scene):
    analysis = Analysis.of(scene())
    found = acceleration_limits(analysis, 24, turning=False)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(200, 3))
    reach = np.array([(found.offsets / np.maximum(found.normals @ d, 1e-12)).min() for d in directions])
    accelerations = directions * (0.999 * np.minimum(reach, 500))[:, None]
    for acceleration in accelerations:
        for block in analysis.blocks:
            assert block.solvers.limit.inverse_factor(inertial_loads(block) @ acceleration).value <= 1 + 1e-6
    # And it is not much smaller than what is sustained: every horizontal limit lies on it.
    for direction, limit in zip(found.directions, found.limits, strict=True):
        assert (found.offsets / np.maximum(found.normals @ direction, 1e-12)).min() == pytest.approx(limit, rel=1e-3)


def test_turning_throws_a_block_out_where_centripetal_acceleration_meets_friction():
    """At radius r: speed sqrt(mu g / r); angular acceleration mu g / r for a block whose own spin takes little."""
    mu, radius = 0.4, 2.0
    small = on_floor(box("coin", (0.1, 0.1, 0.01), (radius, 0, 0.005)), friction=mu)
    found = acceleration_limits(small, 4)
    assert found.angular_speed == pytest.approx(np.sqrt(mu * G / radius), rel=1e-3)
    assert found.angular_acceleration == pytest.approx(mu * G / radius, rel=1e-2)


def test_a_disc_on_the_axis_spins_up_until_its_patch_turns():
    """mu m g 2/3 r = m r^2 / 2 alpha."""
    mu, radius = 0.3, 0.2
    disc = on_floor(scenes.cylinder("disc", radius, 0.02, (0, 0, 0.01)), friction=mu)
    found = acceleration_limits(disc, 4)
    assert found.angular_acceleration == pytest.approx(mu * G * (2 / 3) / (radius / 2), rel=5e-3)
    assert found.angular_speed == np.inf


def test_a_tilted_tray_holds_until_its_slope_is_the_friction_angle():
    found = acceleration_limits(scenes.cube(0.5), 8)
    np.testing.assert_allclose(np.tan(found.tilts(G)), 0.5, rtol=1e-6)
    angle = found.tilts(G)[0] - 1e-3
    gravity = G * np.array([-np.sin(angle), 0, -np.cos(angle)])
    cube = scenes.cube(0.5)
    assert Analysis.of(Assembly(cube.objects, gravity, 0.5)).stability().stable
    steeper = G * np.array([-np.sin(angle + 2e-3), 0, -np.cos(angle + 2e-3)])
    assert not Analysis.of(Assembly(cube.objects, steeper, 0.5)).stability().stable


def test_limits_do_not_depend_on_mass_or_on_where_the_tray_is():
    first = acceleration_limits(scenes.stack(3), 12)
    heavy = Assembly(scenes.stack(3, masses=[10.0] * 3).objects, scenes.GRAVITY, 0.5)
    shifted = []
    for item in heavy.objects:
        pose = Pose(item.pose.rotation, item.pose.translation + np.array([5.0, -3, 2]))
        shifted.append(RigidObject(item.id, item.shape, pose, item.fixed, item.mass))
    second = acceleration_limits(Assembly(tuple(shifted), scenes.GRAVITY, 0.5), 12)
    np.testing.assert_allclose(second.limits, first.limits, rtol=1e-6)


def test_between_walls_only_what_elastic_contacts_hold_counts():
    """Along the walls friction of the floor alone holds the cube: mu g."""
    found = acceleration_limits(scenes.between_walls(with_floor=True), np.array([[0.0, 1, 0]]), turning=False)
    assert found.limits[0] == pytest.approx(0.5 * G, rel=0.01)


@pytest.mark.parametrize(
    ("directions", "code"),
    [
        (0, ErrorCode.BAD_INPUT),
        (np.zeros((2, 3)), ErrorCode.BAD_INPUT),
        (np.ones((2, 2)), ErrorCode.BAD_INPUT),
        (np.array([[np.nan, 0, 1]]), ErrorCode.NOT_FINITE),
    ],
)
def test_bad_directions_are_refused(directions, code):
    with pytest.raises(InputError) as caught:
        acceleration_limits(scenes.cube(), directions)
    assert caught.value.code is code


def test_what_does_not_stand_has_no_limits():
    with pytest.raises(NoAnswerError):
        acceleration_limits(scenes.between_walls(with_floor=False))
    assert FLOOR.fixed
