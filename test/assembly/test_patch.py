"""Friction spread as under uniform pressure: against integrals over the patch, and against limit analysis."""

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import G, box, on_floor
from scipy.optimize import brentq

from poise.assembly import Analysis, Box, Cylinder, Push, RigidObject, assess
from poise.assembly.contact.contacts import find_interfaces
from poise.assembly.statics.friction_surface import FrictionSurface, patch_friction
from poise.assembly.statics.patch import PatchProgram
from poise.assembly.statics.pushes import loads_of
from poise.geometry import Pose

# Quadrature of the reference: midpoints of a fine grid.
FINE = 400


def rectangle(length, width):
    x = ((np.arange(FINE) + 0.5) / FINE - 0.5) * length
    y = ((np.arange(FINE) + 0.5) / FINE - 0.5) * width
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def uniform_pressure_limit(points, mu_weight, lever):
    """Force along x at a lever (y) that a uniformly pressed patch just holds.

    The patch turns about a centre (0, c); friction opposes the motion everywhere. Balance of moments gives c.
    """

    def force_and_moment(c):
        velocity = np.stack([-(points[:, 1] - c), points[:, 0]], axis=1)
        unit = velocity / np.maximum(np.linalg.norm(velocity, axis=1), 1e-12)[:, None]
        return -unit[:, 0].mean(), -(points[:, 0] * unit[:, 1] - points[:, 1] * unit[:, 0]).mean()

    def unbalanced(c):
        force, moment = force_and_moment(c)
        return moment + force * lever  # the force at (0, lever) along x has the moment -lever

    size = np.abs(points).max()
    centre = brentq(unbalanced, -1e3 * size, -1e-6 * size) if lever > 0 else -1e9
    return abs(force_and_moment(centre)[0]) * mu_weight


@pytest.mark.parametrize(("length", "width"), [(1, 1), (2, 1), (4, 1)])
@pytest.mark.parametrize("share", [0.2, 0.5, 1.0])
def test_a_push_off_centre_turns_a_box_at_what_uniform_pressure_holds(length, width, share):
    """To 2 %, by the default model and by `patch`; limit analysis may gather the pressure far out and holds more."""
    mu, lever = 0.5, share * width / 2
    assembly = on_floor(box("box", (length, width, 0.5), (0, 0, 0.25)), friction=mu)
    push = Push("box", (-length / 2, lever, 0), (1, 0, 0))
    expected = uniform_pressure_limit(rectangle(length, width), mu * G, lever)
    for model in ("default", "patch"):
        assert assess(assembly, [push], model).results[0].robustness == pytest.approx(expected, rel=0.02)
    assert assess(assembly, [push], "limit").results[0].robustness > expected


@pytest.mark.parametrize("lever", [0.1, 0.3])
def test_a_disc_turns_at_what_uniform_pressure_holds(lever):
    mu, radius = 0.4, 0.3
    points = rectangle(2 * radius, 2 * radius)
    points = points[np.linalg.norm(points, axis=1) <= radius]
    can = on_floor(scenes.cylinder("can", radius, 0.4, (0, 0, 0.2)), friction=mu)
    push = Push("can", (-np.sqrt(radius**2 - lever**2), lever, 0), (1, 0, 0))
    expected = uniform_pressure_limit(points, mu * G, lever)
    assert assess(can, [push]).results[0].robustness == pytest.approx(expected, rel=0.02)


def test_two_pushes_that_only_turn_meet_the_mean_radius():
    """A couple of forces F at levers +-d: 2 F d = mu W r, r two thirds of a disc's radius."""
    mu, radius = 0.4, 0.3
    can = on_floor(scenes.cylinder("can", radius, 0.4, (0, 0, 0.2)), friction=mu)
    couple = [Push("can", (0, side * radius, 0), (side, 0, 0)) for side in (1, -1)]
    found = assess(can, [couple]).results[0]
    assert found.robustness == pytest.approx(mu * G * (2 / 3 * radius) / (2 * radius), rel=5e-3)
    assert found.mode == "slip"


def test_the_limit_surface_is_that_of_uniform_pressure():
    """Friction of random motions, integrated over the patch, lies on the surface: its inverse load factor is 1."""
    interface = find_interfaces(on_floor(box("box", (1.5, 0.7, 1), (0, 0, 0.5))))[0]
    friction = patch_friction(interface)
    points = rectangle(1.5, 0.7) / friction.size
    flip = np.stack([friction.axes[:, 0], friction.axes[:, 1]], axis=1)
    points = points @ flip.T
    rng = np.random.default_rng(0)
    for velocity, turning in zip(rng.normal(size=(40, 2)), rng.normal(0, 2, 40), strict=True):
        motion = velocity + turning * np.stack([-points[:, 1], points[:, 0]], axis=1)
        unit = motion / np.linalg.norm(motion, axis=1)[:, None]
        moment = (points[:, 0] * unit[:, 1] - points[:, 1] * unit[:, 0]).mean()
        inverse = friction.surface.normal_force_needed(unit.mean(axis=0)[None], np.array([moment]))
        assert inverse[0] == pytest.approx(1, abs=6e-3)


@pytest.mark.parametrize(("length", "width"), [(1, 1), (2, 1), (4, 1), (10, 1)])
def test_a_few_cells_cost_what_the_whole_patch_does(length, width):
    surface = patch_friction(find_interfaces(on_floor(box("b", (length, width, 1), (0, 0, 0.5))))[0]).surface
    cells = surface.cells()
    rng = np.random.default_rng(1)
    velocity, turning = rng.normal(size=(200, 2)), rng.normal(0, 2, 200)
    u = velocity[:, 0, None] - turning[:, None] * cells.places[:, 1]
    v = velocity[:, 1, None] + turning[:, None] * cells.places[:, 0]
    cost = np.sqrt(u**2 + v**2 + (turning[:, None] * cells.spins) ** 2) @ cells.weights
    np.testing.assert_allclose(cost, surface.dissipation(velocity, turning), rtol=0.035)
    turn = cells.weights @ np.sqrt((cells.places**2).sum(axis=1) + cells.spins**2)
    assert turn == pytest.approx(surface.radius, rel=1e-6)


def test_friction_acts_about_the_centre_of_pressure():
    """A box whose weight lies off centre slides straight when pushed in line with it, at mu W."""
    off = on_floor(box("box", (1, 1, 0.2), (0, 0, 0.1), com=np.array([0, 0.2, 0])))
    found = assess(off, [Push("box", (-0.5, 0.2, 0), (1, 0, 0)), Push("box", (-0.5, 0, 0), (1, 0, 0))]).results
    assert found[0].robustness == pytest.approx(0.5 * G, rel=1e-6)
    assert found[1].robustness < 0.97 * 0.5 * G


def test_the_program_of_several_interfaces_agrees_with_the_root_of_one():
    """The same cube through both, for pushes of every kind: to the 5.5 % that cells and resting centres leave."""
    analysis = Analysis.of(scenes.cube())
    block = analysis.blocks[0]
    program = PatchProgram(block.geometry, block.interfaces)
    rng = np.random.default_rng(3)
    pushes = [
        Push("cube", (-0.5, y, z), (1, *rng.normal(0, 0.3, 2))) for y, z in rng.uniform([-0.5, 0], [0.5, 1], (60, 2))
    ]
    loads = loads_of(analysis.assembly, pushes, 1e-3)
    single = block.solvers.single_patch.collapse(loads.wrench).factor
    _, scaled = block.loads(loads)
    limits = block.solvers.limit.each(scaled)
    for factor, limit, inverse in zip(
        single, limits, program.inverse_factors(scaled, limits, np.zeros(len(scaled))), strict=True
    ):
        most = 1 / limit.value
        assert min(1 / max(inverse.value, 1e-12), most) == pytest.approx(min(factor, most), rel=0.055)


def test_mechanisms_of_a_single_patch_give_way_along_the_push():
    rng = np.random.default_rng(5)
    analysis = Analysis.of(scenes.cube())
    for y, z in rng.uniform([-0.5, 0.05], [0.5, 1], (30, 2)):
        found = assess(analysis, [Push("cube", (-0.5, y, z), (1, 0, 0))], "patch").results[0]
        linear, angular = found.mechanism[0, :3], found.mechanism[0, 3:]
        at_push = linear + np.cross(angular, np.array([-0.5, y, z]) - [0, 0, 0.5])
        assert at_push[0] == pytest.approx(1)
        at_base = linear + np.cross(angular, [0.5 * np.sign(angular[1]) if found.mode == "topple" else 0, 0, -0.5])
        assert at_base[2] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("points", [[[0, 0], [0, 0], [0, 0]], [[0, 0], [1, 0], [0, 1]]])
def test_what_weighs_nothing_makes_no_number_infinite(points):
    """Slivers between meshes leave patches whose triangles have no area, or lie on one point."""
    cells = FrictionSurface(np.array(points, dtype=float), np.array([1.0, 0.0, 0.0])).cells()
    for values in (cells.weights, cells.places, cells.spins):
        assert np.isfinite(values).all()
    assert cells.weights.sum() == pytest.approx(1.0)


def test_the_normal_force_for_one_load_is_that_for_many():
    rng = np.random.default_rng(3)
    surface = FrictionSurface(rectangle(0.4, 0.1)[::97], np.full(len(rectangle(0.4, 0.1)[::97]), 97 / FINE**2))
    loads = rng.normal(size=(50, 3))
    loads[:4] = [[1, 0, 0], [-1, 0, -1], [0, -1, 0], [0, 0, -1]]
    many = surface.normal_force_needed(loads[:, :2], loads[:, 2])
    assert [surface.normal_force_needed_for(*load) for load in loads.tolist()] == pytest.approx(many, rel=1e-12)


def test_a_few_questions_about_friction_are_answered_as_many_are():
    """The table of a patch is filled only where few loads ask, and says the same there."""
    rng = np.random.default_rng(4)
    points, weights = rng.normal(size=(50, 2)), np.full(50, 1 / 50)
    loads = rng.normal(size=(200, 3))
    few, many = FrictionSurface(points, weights), FrictionSurface(points, weights)
    one_by_one = [few.normal_force_needed(load[None, :2], load[2:])[0] for load in loads]
    assert one_by_one == pytest.approx(many.normal_force_needed(loads[:, :2], loads[:, 2]), rel=1e-12)


def test_a_push_through_the_centre_slides_at_the_friction_in_each_direction():
    """The motions of the table are some degrees apart, which gave up to 0.2 % more than friction holds."""
    can = RigidObject("can", Cylinder(0.06, 0.04), Pose(np.eye(3), np.array([0, 0, 0.02])), mass=1.5)
    angles = np.linspace(0, 2 * np.pi, 90)
    outward = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    pushes = [Push("can", 0.06 * out + [0, 0, 0.01], tuple(-out)) for out in outward]
    analysis = Analysis.of(on_floor(can, friction=0.4))
    for asked in (pushes, pushes[7:8]):
        for result in assess(analysis, asked).results:
            assert result.robustness == pytest.approx(1.5 * G * 0.4, rel=1e-6)


@pytest.mark.parametrize("shape", [Box((1.0, 0.3, 0.2)), Cylinder(0.3, 0.5)])
def test_many_loads_collapse_at_what_few_do(shape):
    """Of many loads those far from slipping are not looked at closely."""
    item = RigidObject(
        "one", shape, Pose(np.eye(3), np.array([2.0, 1.0, 0.1 if isinstance(shape, Box) else 0.25])), mass=1
    )
    patch = Analysis.of(on_floor(item)).blocks[0].solvers.single_patch
    loads = np.random.default_rng(3).normal(size=(240, 6)) * [1, 1, 3, 2, 2, 2]
    many, few = patch.collapse(loads), [patch.collapse(some) for some in np.split(loads, 8)]
    np.testing.assert_allclose(many.factor, np.concatenate([each.factor for each in few]), rtol=1e-11)
    assert np.array_equal(many.slips, np.concatenate([each.slips for each in few]))
    assert 0.2 < many.slips.mean() < 0.95
