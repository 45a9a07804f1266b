"""Turns and mirrorings of blocks: which are found, and that answers carried by them are those asked one by one."""

from dataclasses import replace

import numpy as np
import pytest
from assembly_scenes import box, on_floor

from benchmarks.growth import tables, wall
from benchmarks.mirrored import pyramid, row, turned
from poise.assembly import Analysis, Assembly, Box, RigidObject, acceleration_limits, robustness_map
from poise.assembly.robustness.elastic_limits import ElasticLimits, inertial_loads
from poise.assembly.statics import NO_DEADLINE, Symmetry
from poise.assembly.statics.block_solvers import BlockSolvers
from poise.geometry import Pose, wrench_of_force

COUNT = 24


def with_mass(assembly: Assembly, name: str, factor: float) -> Assembly:
    """The same scene with one mass changed."""
    items = [replace(item, mass=factor * item.mass) if item.id == name else item for item in assembly.objects]
    return Assembly(tuple(items), assembly.gravity, assembly.friction)


def ring(count: int) -> Assembly:
    """A square lid on equal posts in a circle, one block."""
    azimuths = 2 * np.pi * np.arange(count) / count
    posts = [
        RigidObject(f"post{k}", Box((0.1, 0.1, 1.0)), pose_at(azimuth), mass=1.0)
        for k, azimuth in enumerate(azimuths.tolist())
    ]
    return on_floor(*posts, box("lid", (2, 2, 0.1), (0, 0, 1.05)))


def pose_at(azimuth: float) -> Pose:
    c, s = np.cos(azimuth), np.sin(azimuth)
    return Pose(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([0.6 * c, 0.6 * s, 0.5]))


def largest(assembly: Assembly):
    return max(Analysis.of(assembly).blocks, key=lambda block: block.geometry.count)


@pytest.mark.parametrize(
    ("scene", "count"),
    [
        (wall(10), 3),
        (turned(wall(10), 0.4), 3),
        (wall(11), 1),  # a brick alone on top, beside the middle
        (with_mass(wall(10), "b1", 1.001), 3),  # the middle of the lowest row
        (with_mass(wall(10), "b0", 1.001), 1),
        (tables(3), 3),
        (ring(4), 7),
        (ring(3), 5),  # contacts count, not the shape of the lid
        (on_floor(box("cube", (1, 1, 1), (3, 2, 0.5))), 7),  # one interface, on the axis
        (turned(on_floor(box("slab", (2, 1, 0.2), (3, 2, 0.1))), 0.4), 3),
        (on_floor(box("low", (1, 1, 1), (0, 0, 0.5)), box("high", (1, 1, 1), (0.2, 0, 1.5))), 1),
    ],
)
def test_turns_and_mirrorings_of_a_block_are_found(scene, count):
    block = largest(scene)
    found = block.solvers.symmetries
    assert len(found) == count
    gravity, loads = block.geometry.gravity.ravel(), inertial_loads(block)
    for symmetry in found:
        np.testing.assert_allclose(symmetry.of_bodies(gravity), gravity, atol=1e-9)
        np.testing.assert_allclose(symmetry.inverse.of_bodies(symmetry.of_bodies(loads[:, 0])), loads[:, 0], atol=1e-12)
        assert symmetry.carries(loads)


def test_an_object_that_is_higher_inside_is_no_image_of_another():
    """Contact forces at rest do not show how high a centre of mass is; what acceleration does, does."""
    scene = wall(10)
    items = [replace(item, com=np.array([0, 0, 0.02])) if item.id == "b0" else item for item in scene.objects]
    block = largest(Assembly(tuple(items), scene.gravity, scene.friction))
    mirrored = [symmetry for symmetry in block.solvers.symmetries if not symmetry.carries(inertial_loads(block))]
    assert len(block.solvers.symmetries) == 3
    assert len(mirrored) == 2


def limits_of(scene: Assembly, monkeypatch: pytest.MonkeyPatch, known: tuple[Symmetry, ...] | None):
    """Limits in all directions, and how many were followed from rest; with these symmetries, None: those found."""
    block = largest(scene)
    if known is not None:
        monkeypatch.setattr(BlockSolvers, "symmetries", known)
    azimuths = 2 * np.pi * np.arange(COUNT) / COUNT
    directions = np.stack([np.cos(azimuths), np.sin(azimuths), 0 * azimuths], axis=1)
    found = ElasticLimits(block, inertial_loads(block), directions, np.full(COUNT, 1e3), NO_DEADLINE).solve()
    monkeypatch.undo()
    return found


@pytest.mark.parametrize("scene", [wall(10), turned(tables(3), 0.4), ring(4)], ids=["wall", "table", "ring"])
def test_limits_that_are_carried_are_those_asked_one_by_one(scene, monkeypatch):
    found, each = limits_of(scene, monkeypatch, None), limits_of(scene, monkeypatch, ())
    np.testing.assert_allclose(found.limits, each.limits, rtol=0.005)
    assert found.from_rest <= 0.6 * each.from_rest
    assert set(found.falls) == set(each.falls)
    for direction, mechanism in found.falls.items():
        assert mechanism.twist @ (found.loads @ found.directions[direction]) > 0
        assert set(mechanism.places) & set(each.falls[direction].places)


def test_no_direction_is_asked_for_less_because_its_image_is():
    """Another block may allow less in one of two directions that are carried into each other."""
    block, directions = largest(tables(3)), np.array([[1.0, 0.3, 0.0], [-1.0, 0.3, 0.0]])
    found = ElasticLimits(block, inertial_loads(block), directions, np.full(2, 1e3), NO_DEADLINE).solve().limits
    for few in (0, 1):
        most = np.where(np.arange(2) == few, 0.5 * found, 1e3)
        again = ElasticLimits(block, inertial_loads(block), directions, most, NO_DEADLINE).solve().limits
        np.testing.assert_allclose(again, np.minimum(found, most), rtol=1e-6)


def test_a_symmetry_that_is_none_carries_no_limit(monkeypatch):
    """The mirrored state is no equilibrium: the direction is asked itself."""
    even = largest(wall(10)).solvers.symmetries
    mirrors = tuple(symmetry for symmetry in even if symmetry.bodies[0] != 0)
    scene = with_mass(wall(10), "b7", 1.5)
    monkeypatch.setattr(Symmetry, "carries", lambda self, loads: True)
    wrong = limits_of(scene, monkeypatch, mirrors)
    each = limits_of(scene, monkeypatch, ())
    assert np.all(wrong.limits <= 1.005 * each.limits)


def test_first_to_move_is_mirrored_with_the_direction():
    found = acceleration_limits(wall(10), np.array([[1.0, 0.2, 0.0], [-1.0, 0.2, 0.0]]), turning=False)
    assert found.limits[0] == pytest.approx(found.limits[1], rel=1e-9)
    places = {item.id: item.pose.translation for item in wall(10).objects}
    first, second = (
        {tuple(np.round(places[name] * sign, 6) + 0.0) for name in names}
        for names, sign in zip(found.first_to_move, (1, np.array([-1, 1, 1])), strict=True)
    )
    assert first == second


STACK = on_floor(*(box(f"c{k}", (1, 1, 1), (0.1, 0.2, 0.5 + k)) for k in range(2)))


@pytest.mark.parametrize(("scene", "points", "share"), [(tables(3), 600, 0.7), (STACK, 4000, 0.3)])
def test_maps_of_mirrored_points_are_those_asked_one_by_one(scene, points, share, monkeypatch):
    found = robustness_map(scene, points)
    monkeypatch.setattr(BlockSolvers, "symmetries", ())
    each = robustness_map(scene, points)
    assert found.solves < share * each.solves
    both = np.isfinite(found.upper) & np.isfinite(each.upper)
    assert np.median(np.abs(found.upper[both] / each.upper[both] - 1)) < 0.01
    assert np.all(found.lower <= 1.05 * each.upper)
    assert np.all(each.lower <= 1.05 * found.upper)


def test_a_mechanism_of_a_map_is_that_of_the_point_itself():
    found = robustness_map(tables(3), 600)
    block, surface = found.analysis.blocks[0], found.surface
    wrenches = block.geometry.units.of_wrench(wrench_of_force(surface.directions, surface.points))
    bodies, checked = block.bodies_of(surface.place), 0
    for point in np.flatnonzero((found.mechanism >= 0) & np.isfinite(found.upper)).tolist():
        power = found.mechanisms[found.mechanism[point]].twist.reshape(-1, 6)[bodies[point]] @ wrenches[point]
        assert 1 / power == pytest.approx(found.upper[point], rel=1e-6)
        checked += 1
    assert checked > 300


def test_the_benchmark_compares_a_pyramid_with_and_without():
    _, symmetries, limits, crossing, *_ = row("pyramid", pyramid(3)).strip("| ").split(" | ")[0:5]
    assert symmetries == "3"
    assert all(abs(float(ratio) - 1) < 0.01 for ratio in limits.split(" to "))
    assert all(float(each) < 1.05 for each in crossing.split("; "))
