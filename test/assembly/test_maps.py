"""Certified maps: the bounds hold at points that were never solved, and meet the tolerance."""

import itertools

import assembly_scenes as scenes
import numpy as np
import pytest
import trimesh
from assembly_scenes import box, on_floor
from hypothesis import given, settings
from hypothesis import strategies as st

from poise.assembly import Analysis, Assembly, Mesh, Push, RigidObject, assess, robustness_map
from poise.assembly.contact.surface import SurfacePoints, sample_surface
from poise.assembly.robustness.convexity import upper_planes
from poise.assembly.robustness.maps import MAX_MAP_POINTS
from poise.assembly.statics.deadline import Deadline
from poise.assembly.statics.load_factor import LoadFactorProgram
from poise.assembly.statics.pushes import loads_of
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose

SCENES = {
    "cube": scenes.cube,
    "stack": lambda: scenes.stack(3),
    "table": scenes.table,
    "wall": lambda: scenes.wall(2, 2),
}


@pytest.mark.parametrize("model", ["limit", "patch", "default"])
@pytest.mark.parametrize("scene", SCENES)
def test_bounds_meet_the_tolerance_and_hold_what_single_queries_say(scene, model):
    analysis = Analysis.of(SCENES[scene]())
    coupled = any(not block.geometry.statically_determinate for block in analysis.blocks)
    found = robustness_map(analysis, 200 if coupled else 600, tolerance=0.05, model=model)
    assert found.complete
    weight = sum(block.geometry.units.weight for block in analysis.blocks)
    strong = found.lower >= 100 * weight
    if coupled and model == "default":  # elastic contacts may hold less than the upper bound allows
        assert_no_bound_is_above_single_pushes(analysis, found, count=12)
        return
    assert found.doubtful.all() == coupled
    assert np.all((found.upper <= 1.0501 * found.lower) | strong)
    rng = np.random.default_rng(0)
    for row in rng.choice(len(found.lower), 40, replace=False):
        factor = single(analysis, found.surface, row, model)
        if found.lower[row] < 100 * weight:
            assert found.lower[row] * (1 - 1e-4) <= factor <= found.upper[row] * (1 + 1e-4)


def assert_no_bound_is_above_single_pushes(analysis, found, count):
    surface, objects = found.surface, analysis.assembly.objects
    rows = np.random.default_rng(0).choice(len(found.lower), count, replace=False)
    pushes = [Push(objects[surface.place[row]].id, surface.points[row], surface.directions[row]) for row in rows]
    answers = np.array([result.robustness for result in assess(analysis, pushes).results])
    assert np.all(found.lower[rows] <= 1.05 * answers)
    assert np.all(found.upper[rows] >= 0.999 * answers)
    assert (found.lower[rows] > 0).mean() > 0.8


def single(analysis, surface, row, model):
    """What the models say of one point; patches of several interfaces with their centres of pressure at rest."""
    item = analysis.assembly.objects[surface.place[row]]
    push = Push(item.id, surface.points[row], surface.directions[row])
    if model == "limit" or len(analysis.blocks) == len(analysis.structure.movable):
        return assess(analysis, [push], model).results[0].upper
    factors = [np.inf]
    for block in analysis.blocks:
        questions, loads = block.loads(loads_of(analysis.assembly, [push], 1e-3))
        if len(questions):
            factors.append(1 / max(block.solvers.patch.resting.inverse_factor(loads[0]).value, 1e-9))
            if model == "default":
                factors.append(1 / max(block.solvers.limit.inverse_factor(loads[0]).value, 1e-9))
    return min(factors)


def test_a_map_takes_far_fewer_solves_than_points():
    found = robustness_map(scenes.cube(), 10_000, model="limit")
    assert len(found.lower) == pytest.approx(10_000, rel=0.02)
    assert found.complete
    assert found.solves < 300


def test_no_load_is_asked_of_limit_analysis_twice(monkeypatch):
    asked, solve, each = [], LoadFactorProgram.inverse_factor, LoadFactorProgram.each

    def counted(program, load, enough=0.0, stuck=False):
        if not stuck:  # otherwise `each` has counted it
            asked.append((id(program), load.tobytes()))
        return solve(program, load, enough, stuck)

    def all_counted(program, loads, enough=None):
        asked.extend((id(program), load.tobytes()) for load in loads)
        return each(program, loads, enough)

    analysis = Analysis.of(scenes.wall(2, 2))
    analysis.stability()
    monkeypatch.setattr(LoadFactorProgram, "inverse_factor", counted)
    monkeypatch.setattr(LoadFactorProgram, "each", all_counted)
    found = robustness_map(analysis, 200)
    limit = id(analysis.blocks[0].solvers.rough_limit)
    loads = [load for program, load in asked if program == limit]
    assert found.solves > len(loads) > 20
    assert len(set(loads)) == len(loads)


def test_a_map_says_who_moves():
    found = robustness_map(scenes.stack(3), 300)
    names = [item.id for item in scenes.stack(3).objects]
    for row in range(0, len(found.lower), 17):
        moves = found.moves(row)
        if np.isfinite(found.upper[row]):
            assert names[found.surface.place[row]] in moves
            assert moves[-1] == "c2"
        else:
            assert moves == ()


def test_a_deadline_returns_bounds_that_hold_and_says_that_it_passed():
    analysis = Analysis.of(scenes.wall(4, 4))
    full = robustness_map(analysis, 500, model="limit")
    early = robustness_map(analysis, 500, model="limit", deadline=0.0)
    assert full.complete
    assert not early.complete
    assert np.all(early.lower <= full.upper * (1 + 1e-6))
    assert np.all(early.upper >= full.lower * (1 - 1e-6))


def test_every_mechanism_bounds_every_point():
    """A mechanism of a map, taken as a cut, never lies above the inverse load factor solved anywhere else."""
    analysis = Analysis.of(scenes.table())
    block = analysis.blocks[0]
    found = robustness_map(analysis, 200, model="limit")
    rng = np.random.default_rng(1)
    for load in rng.normal(size=(30, 18)):
        inverse = block.solvers.limit.inverse_factor(load).upper
        assert max(mechanism.twist @ load for mechanism in found.mechanisms) <= inverse * (1 + 1e-6)


def test_a_curved_surface_is_bounded_too():
    bowl = trimesh.creation.icosphere(3, 0.2)
    bowl.vertices[:, 2] = np.maximum(bowl.vertices[:, 2], -0.15)
    shape = Mesh(np.array(bowl.vertices), np.array(bowl.faces))
    assembly = on_floor(RigidObject("bowl", shape, scenes.pose((0, 0, 0.15)), mass=1.0))
    analysis = Analysis.of(assembly)
    surface = sample_surface(analysis.structure, 3000)
    found = robustness_map(analysis, surface, tolerance=0.1, model="limit")
    assert found.complete
    assert found.solves < 0.75 * len(surface.points)
    for row in range(0, len(found.lower), 150):
        push = Push("bowl", surface.points[row], surface.directions[row])
        single = assess(analysis, [push], "limit").results[0].robustness
        assert found.lower[row] * (1 - 1e-5) <= single <= found.upper[row] * (1 + 1e-5)


def test_points_asked_for_are_the_points_answered():
    points = np.array([[-0.5, 0, 0.2], [-0.5, 0, 0.9], [0.3, 0.1, 1.0]])
    directions = np.array([[1.0, 0, 0], [1, 0, 0], [0, 0, -1]])
    found = robustness_map(scenes.cube(0.9), SurfacePoints(np.ones(3, dtype=int), points, directions), model="limit")
    np.testing.assert_allclose(found.upper, [0.9 * scenes.G, scenes.G * 0.5 / 0.9, np.inf], rtol=0.03)


def test_samples_lie_on_free_surface_evenly_and_point_inward():
    analysis = Analysis.of(scenes.stack(2))
    surface = sample_surface(analysis.structure, 2000)
    top = (surface.place == 2) & (surface.directions[:, 2] < -0.5)
    assert top.sum() == pytest.approx(2000 / 9, rel=0.03)
    assert np.all(surface.points[top, 2] == 2)
    assert not np.any(surface.directions[:, 2] > 0.5)  # undersides are covered
    assert not np.any((surface.points[:, 2] == 1) & (np.abs(surface.directions[:, 2]) > 0.5))


def test_where_limit_analysis_counts_on_forces_between_walls_the_map_does_not():
    found = robustness_map(scenes.between_walls(with_floor=True), 300)
    up = found.surface.directions[:, 2] > 0.5
    assert not up.any()  # the underside rests on the floor
    lifted = SurfacePoints(
        np.full(20, 3),
        np.column_stack([np.linspace(-0.4, 0.4, 20), np.zeros(20), np.ones(20)]),
        np.tile([0.0, 0, 1], (20, 1)),
    )
    found = robustness_map(scenes.between_walls(with_floor=True), lifted)
    assert np.all(found.upper > 10 * scenes.G)
    jammed = np.array(
        [assess(found.analysis, [Push("cube", point, (0, 0, 1))]).results[0].robustness for point in lifted.points[::3]]
    )
    assert jammed[0] > 1.7 * jammed[3]  # lifted off its centre the cube jams: no convex function of the point
    assert np.all(found.lower > 0)
    assert np.all(found.lower[::3] <= 1.05 * jammed)
    assert not robustness_map(scenes.stack(2), 200).doubtful.any()


def test_an_assembly_that_falls_has_no_map():
    with pytest.raises(NoAnswerError) as caught:
        robustness_map(scenes.between_walls(with_floor=False), 100)
    assert caught.value.code is ErrorCode.UNSTABLE


def test_models_without_bounds_are_refused():
    with pytest.raises(InputError, match="certified"):
        robustness_map(scenes.cube(), 100, model="coulomb")


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(4, 30))
def test_planes_bound_a_convex_function_from_above_and_touch_it_where_it_is_known(seed, count):
    rng = np.random.default_rng(seed)
    slopes, offsets = rng.normal(size=(5, 2)), rng.normal(size=5)

    def function(points):
        return (points @ slopes.T + offsets).max(axis=1)

    corners = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    known = np.concatenate([corners, rng.uniform(-1, 1, (count, 2))])
    planes = upper_planes(known, function(known))

    def bound(points):
        return (points @ planes[:, :2].T + planes[:, 2]).max(axis=1)

    inside = rng.uniform(-1, 1, (200, 2))
    assert np.all(bound(inside) >= function(inside) - 1e-9)
    np.testing.assert_allclose(bound(known), function(known), atol=1e-9)


def test_tiny_blocks_on_tiny_trays_are_mapped_as_well_as_big_ones():
    """Everything is scaled to the block: a millimetre cube of a gram behaves as a metre cube of a kilogram."""
    tiny = on_floor(box("chip", (0.01, 0.01, 0.01), (0, 0, 0.005), mass=1e-3))
    found = robustness_map(tiny, 300, model="limit")
    big = robustness_map(scenes.cube(), 300, model="limit")
    assert found.complete
    assert np.min(found.upper) / 1e-3 == pytest.approx(np.min(big.upper), rel=0.05)


def test_a_deadline_ends_a_map_without_asking_for_the_rest():
    found = robustness_map(scenes.cube(), 200, model="patch", deadline=0.0)
    assert not found.complete
    assert np.all(found.lower == 0)
    assert np.all(np.isinf(found.upper))


@pytest.mark.parametrize("model", ["patch", "default"])
def test_a_deadline_in_the_middle_leaves_bounds_that_hold(model, monkeypatch):
    analysis = Analysis.of(scenes.stack(3))
    full = robustness_map(analysis, 500, model=model)
    monkeypatch.setattr("poise.assembly.robustness.map_regions.ROW_CHUNK", 20)
    looks = itertools.count()
    monkeypatch.setattr(Deadline, "passed", property(lambda _: next(looks) > 45))
    early = robustness_map(analysis, sample_surface(analysis.structure, 500), model=model)
    reached = early.lower > 0
    assert not early.complete
    assert 0 < reached.sum() < len(reached)
    assert np.all(early.lower <= full.upper * (1 + 1e-6))
    assert np.all(early.upper >= full.lower * (1 - 1e-6))
    assert next(looks) < 100


def test_a_map_has_a_largest_size():
    with pytest.raises(InputError, match="1000000 at most") as refused:
        robustness_map(scenes.cube(), MAX_MAP_POINTS + 1)
    assert refused.value.code is ErrorCode.BAD_INPUT


@pytest.mark.parametrize("count", [0, -1])
def test_a_map_without_points_is_refused(count):
    with pytest.raises(InputError, match="at least one") as refused:
        robustness_map(scenes.cube(), count)
    assert refused.value.code is ErrorCode.BAD_INPUT


def test_chunks_of_rows_change_no_bound(monkeypatch):
    scene = on_floor(capsule())
    whole = robustness_map(scene, 600)
    monkeypatch.setattr("poise.assembly.robustness.map_regions.ROW_CHUNK", 7)
    parts = robustness_map(scene, 600)
    np.testing.assert_allclose(parts.lower, whole.lower, rtol=1e-9)
    np.testing.assert_allclose(parts.upper, whole.upper, rtol=1e-9)


def capsule():
    """A capsule that stands on the flat cut through its lower cap."""
    round_one = trimesh.creation.capsule(radius=0.05, height=0.1, count=(12, 12))
    bottom = round_one.bounds[0, 2] + 0.02
    cut = trimesh.intersections.slice_mesh_plane(round_one, [0, 0, 1], [0, 0, bottom], cap=True)
    pose = Pose.from_vector([0, 0, -bottom, 0, 0, 0, 1])
    return RigidObject("capsule", Mesh(np.array(cut.vertices), np.array(cut.faces)), pose, mass=1.0)


def test_a_map_of_fixed_objects_alone_is_refused():
    fixed = Assembly((scenes.fixed_box("floor", (1, 1, 0.1), (0, 0, -0.05)),))
    with pytest.raises(InputError, match="all objects of this assembly are fixed") as raised:
        robustness_map(fixed, 20)
    assert raised.value.code == ErrorCode.EMPTY
