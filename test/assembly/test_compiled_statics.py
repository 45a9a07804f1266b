"""Compiled programs and elastic contacts of blocks of bodies against their forms in Python."""

import dataclasses

import assembly_scenes as scenes
import numpy as np
import pytest

from benchmarks.growth import wall
from poise.assembly import Analysis, Push
from poise.assembly.robustness.elastic_limits import inertial_loads
from poise.assembly.statics import BlockAnalysis, loads_of, pair_program
from poise.assembly.statics.coulomb import FACTOR_TOLERANCE, CoulombBlock
from poise.assembly.statics.deadline import NO_DEADLINE, Deadline
from poise.assembly.statics.elimination import Elimination
from poise.assembly.statics.load_factor import UNLIMITED
from poise.assembly.statics.load_path import _BEYOND
from poise.assembly.statics.newton_goal import Goal, newton_steps
from poise.errors import InputError
from poise.kernels import COMPILED, CompiledBodies, CompiledElastic
from poise.types import Array

pytestmark = pytest.mark.skipif(not COMPILED, reason="the kernels are not installed")


def slab_on_posts():
    """Discs of 64 corners and several cells: springs of a pair that fill vectors of eight, the last only in part."""
    posts = [scenes.cylinder(f"post{k}", 0.08, 0.4, (x, 0.1 * k, 0.2)) for k, x in enumerate((-0.5, 0.5))]
    return scenes.on_floor(*posts, scenes.box("slab", (1.4, 0.6, 0.1), (0.0, 0.0, 0.45)))


SCENES = {
    "table": scenes.table,
    "wall": lambda: scenes.wall(4, 3),
    "walls": lambda: scenes.between_walls(True),
    "posts": slab_on_posts,
}


@pytest.fixture(params=SCENES)
def block(request: pytest.FixtureRequest):
    """The largest block of a scene, in which contact forces have a choice."""
    return max(Analysis.of(SCENES[request.param]()).blocks, key=lambda block: block.geometry.count)


def loads(size: int, count: int) -> Array:
    return np.random.default_rng(size).normal(size=(count, size))


def test_loads_that_are_asked_together_are_answered_as_one_by_one(block) -> None:
    given = loads(6 * block.geometry.count, 5)
    given[3] = 0.0
    for some in (given, given[:3]):
        for load, found in zip(some, block.solvers.limit.each(some), strict=True):
            alone = block.solvers.limit.inverse_factor(load)
            assert (found.value, found.upper) == (alone.value, alone.upper)
            assert np.array_equal(found.twist, alone.twist)
            assert (found.multipliers is None) == (alone.multipliers is None)
            assert found.multipliers is None or np.array_equal(found.multipliers, alone.multipliers)


@pytest.mark.parametrize("equal", [False, True])
@pytest.mark.parametrize("program", ["limit", "patch"])
def test_eight_loads_side_by_side_are_answered_as_each_alone(block, program: str, equal: bool) -> None:
    """To the last bit, whichever other loads are in the lanes beside it, and in lanes that end early or are lost."""
    solver = getattr(block.solvers, program)
    solver = getattr(solver, "resting", solver)
    if solver is None:
        pytest.skip("patches do not hold this block")
    rows = dataclasses.replace(solver._program._rows, equal=equal)
    asked = pair_program.PairProgram(rows, solver._program._tolerance, solver._program.order)
    given = loads(6 * block.geometry.count, 21)
    given[:4] *= np.array([[1e-9], [1e-3], [1e3], [1e6]])
    given[5] = block.geometry.gravity.ravel()
    given[6] = 0.0
    enough = np.full(21, -np.inf)
    enough[7:10] = np.abs(given[7:10]).max(axis=1)
    together = asked._compiled.solve(given[:, asked.order.entries], enough)
    assert equal or (together.outcome == 0).sum() > 6
    for row in range(len(given)):
        alone = asked._compiled.solve(given[row : row + 1, asked.order.entries], enough[row : row + 1])
        for found, one in zip(together, alone, strict=True):
            np.testing.assert_array_equal(found[row], one[0])


def pushed_table(pushes: list[Push]) -> tuple[BlockAnalysis, Array]:
    """A slab on two legs, and the loads of pushes."""
    block = max(Analysis.of(scenes.table()).blocks, key=lambda block: block.geometry.count)
    return block, block.loads(loads_of(block.structure.assembly, pushes, 1e-3))[1]


def test_programs_in_which_rounding_grows_are_solved_with_corrected_steps() -> None:
    sides = [(y, z) for y in np.linspace(-0.47, 0.47, 9).tolist() for z in np.linspace(0.1, 0.9, 7).tolist()]
    block, given = pushed_table([Push("left", (-1.0, y, z), (1, 0, 0)) for y, z in sides])
    sizes = np.abs(given).max(axis=1)
    found = block.solvers.limit.inverse_factors(given, np.zeros(len(given)))
    program = block.solvers.limit._program
    assert program.solve_all(given / sizes[:, None], np.zeros(len(given))).solved.mean() > 0.95
    direct = [program.solve_directly(load / size) for load, size in zip(given, sizes, strict=True)]
    np.testing.assert_allclose(found.value, sizes * [one.value for one in direct], rtol=1e-7)
    np.testing.assert_allclose(found.upper, sizes * [one.upper for one in direct], rtol=1e-7)


def test_pushes_just_short_of_collapse_are_held_as_each_alone() -> None:
    """Where a path finds no next point close to what is asked, the kernel takes the step that Python takes."""
    below = [(x, y) for x in (-0.72, -0.66, -0.6, 0.6, 0.66) for y in (-0.15, 0.1)]
    block, given = pushed_table([Push("slab", (x, y, 1.0), (0, 0, 1)) for x, y in below])
    coulomb = CoulombBlock(block.geometry, block.interfaces, block.solvers.order)
    above = 0.98 / block.solvers.limit.inverse_factors(given, np.zeros(len(given))).value
    short = 0
    for load, most, one in zip(given, above.tolist(), coulomb.factors(given, above), strict=True):
        path = coulomb._follow(load, most, NO_DEADLINE, FACTOR_TOLERANCE, look=True)
        short += not path.ended and path.best.factor > 0.992 * most
        alone = coulomb._followed(load, most, NO_DEADLINE, np.inf, FACTOR_TOLERANCE)
        assert (one.value, one.known) == (alone.value, alone.known)
        np.testing.assert_array_equal(one.displacement, alone.displacement)
    assert short > 3


@pytest.mark.parametrize("program", ["limit", "patch"])
def test_collapse_loads_are_those_of_clarabel(block, program: str, monkeypatch: pytest.MonkeyPatch) -> None:
    solver = getattr(block.solvers, program)
    solver = getattr(solver, "resting", solver)
    if solver is None:
        pytest.skip("patches do not hold this block")
    for load in loads(6 * block.geometry.count, 4):
        monkeypatch.setattr(pair_program, "COMPILED", True)
        found = solver.inverse_factor(load)
        monkeypatch.setattr(pair_program, "COMPILED", False)
        direct = solver.inverse_factor(load)
        assert found.value == pytest.approx(direct.value, rel=2e-5, abs=UNLIMITED)
        assert found.upper >= direct.value * (1 - 1e-6)
        assert found.twist @ load == pytest.approx(found.value, rel=1e-6, abs=UNLIMITED)


def test_margins_of_stability_are_those_of_clarabel(block, monkeypatch: pytest.MonkeyPatch) -> None:
    fast = block.solvers._stability(block.geometry).margin
    monkeypatch.setattr(pair_program, "COMPILED", False)
    assert fast == pytest.approx(block.solvers._stability(block.geometry).margin, rel=1e-5, abs=1e-8)


def both(block) -> tuple[CoulombBlock, CoulombBlock]:
    """Elastic contacts in C, and in Python."""
    compiled, python = (CoulombBlock(block.geometry, block.solvers.interfaces) for _ in range(2))
    python.contacts.compiled = None
    return compiled, python


def test_steps_of_elastic_contacts_are_those_of_python(block) -> None:
    compiled, python = both(block)
    gravity = block.geometry.gravity.ravel()
    load = gravity + 0.05 * np.linalg.norm(gravity) * loads(len(gravity), 1)[0]
    near = compiled._glued(gravity)
    np.testing.assert_allclose(near, python._glued(gravity), rtol=1e-6, atol=1e-7 * np.abs(near).max())
    scale = np.abs(load).max()
    np.testing.assert_allclose(compiled._left(near, load), python._left(near, load), rtol=0, atol=1e-9 * scale)
    responses = [each._response(near, load) for each in (compiled, python)]
    np.testing.assert_allclose(*responses, rtol=0, atol=1e-6 * np.abs(responses[1]).max())
    bounds = np.full(len(compiled.contacts.stiffness), 0.01 * scale)
    for limits in (None, bounds):
        moved = [each._descend(load, near, limits, 2, NO_DEADLINE) for each in (compiled, python)]
        np.testing.assert_allclose(*moved, rtol=0, atol=1e-6 * np.abs(moved[1]).max())


def test_blocks_settle_and_collapse_as_in_python(block) -> None:
    compiled, python = both(block)
    assert compiled.rest.stands == python.rest.stands
    forces = [each.forces(each.rest.displacement) for each in (compiled, python)]
    np.testing.assert_allclose(*forces, rtol=0, atol=1e-4 * np.abs(forces[1]).max())
    for load in loads(6 * block.geometry.count, 2):
        found, expected = (each.factor(load, 100.0) for each in (compiled, python))
        assert found.known
        assert expected.known
        assert found.value == pytest.approx(expected.value, rel=2 * FACTOR_TOLERANCE)


def test_pushes_that_are_followed_together_are_held_as_each_alone(block) -> None:
    compiled, python = both(block)
    python.rest = compiled.rest
    given, above = loads(6 * block.geometry.count, 6), np.array([100.0, 0.01, 100.0, 100.0, 0.3, 1.0])
    found = compiled.factors(given, above)
    for load, most, one in zip(given, above.tolist(), found, strict=True):
        alone = compiled._followed(load, most, NO_DEADLINE, np.inf, FACTOR_TOLERANCE)
        assert (one.value, one.known) == (alone.value, alone.known)
        for first, second in ((one.displacement, alone.displacement), (one.earlier, alone.earlier)):
            np.testing.assert_array_equal(first, second)
        assert (one.twist is None) == (alone.twist is None)
        assert one.twist is None or np.array_equal(one.twist, alone.twist)
        assert one.value == pytest.approx(python.factor(load, most).value, rel=2 * FACTOR_TOLERANCE)
        assert compiled.held_at(load, one.displacement) == pytest.approx(one.value, rel=1e-4) or one.value == most
    late = compiled.contacts.compiled.factors(
        block.geometry.gravity.ravel(), compiled.rest.displacement, given, (above, above), (0.004, Deadline(0.0))
    )
    assert [(one.value, one.known) for one in late] == [(0.0, False)] * 6


def test_paths_are_those_of_python(block) -> None:
    compiled, python = both(block)
    python.rest = compiled.rest
    for load in loads(6 * block.geometry.count, 2):
        found, expected = (each._follow(load, 100.0, NO_DEADLINE, FACTOR_TOLERANCE) for each in (compiled, python))
        assert found.ended == expected.ended
        assert found.best.factor == pytest.approx(expected.best.factor, rel=2 * FACTOR_TOLERANCE)
        for first, second in zip(found.points[:4], expected.points[:4], strict=True):
            assert first.factor == pytest.approx(second.factor, rel=1e-5)
            assert first.compliance == pytest.approx(second.compliance, rel=1e-3)
            assert first.steps == second.steps
        begin = found.points[min(2, len(found.points) - 1)]
        again, other = (each._follow(load, 100.0, NO_DEADLINE, FACTOR_TOLERANCE, begin) for each in (compiled, python))
        assert again.points[1].factor == begin.factor
        assert again.best.factor == pytest.approx(other.best.factor, rel=2 * FACTOR_TOLERANCE)


def test_paths_of_many_bodies_go_on_along_what_the_load_changes() -> None:
    block = Analysis.of(wall(24)).blocks[0]
    compiled, python = both(block)
    python.rest = compiled.rest
    load = inertial_loads(block) @ [1.0, 0.3, 0.0]
    found, expected = (each._follow(load, 100.0, NO_DEADLINE, FACTOR_TOLERANCE) for each in (compiled, python))
    assert found.best.factor == pytest.approx(expected.best.factor, rel=2 * FACTOR_TOLERANCE)
    for first, second in zip(found.points[1:4], expected.points[1:4], strict=True):
        assert first.factor == pytest.approx(second.factor, rel=1e-5)
        assert first.steps == second.steps
        assert load @ second.change == pytest.approx(second.compliance)


def test_states_beyond_the_end_of_a_path_are_those_of_python(block) -> None:
    compiled, python = both(block)
    python.rest = compiled.rest
    for load in loads(6 * block.geometry.count, 4):
        given = load, 100.0, NO_DEADLINE, FACTOR_TOLERANCE
        found, expected = (each._follow(*given, look=True) for each in (compiled, python))
        assert found.ended == expected.ended
        assert len(found.points) == len(expected.points)
        if not found.ended:
            assert found.best.factor == pytest.approx((1 + _BEYOND * FACTOR_TOLERANCE) * found.points[-2].factor)
            assert compiled.held_at(load, found.end) == pytest.approx(found.best.factor, rel=1e-4)


def test_a_path_of_which_no_time_is_left_has_not_ended(block) -> None:
    compiled, _ = both(block)
    load = loads(6 * block.geometry.count, 1)[0]
    found = compiled._follow(load, 100.0, Deadline(0.0), FACTOR_TOLERANCE)
    assert not found.ended
    assert len(found.points) == 1
    np.testing.assert_array_equal(found.points[0].displacement, compiled.rest.displacement)


def test_few_steps_to_a_point_of_the_path_are_not_damped(block) -> None:
    compiled, python = both(block)
    gravity, rest = block.geometry.gravity.ravel(), compiled.rest.displacement
    size, ends = 1e-9 * np.linalg.norm(gravity), []
    for load in loads(len(gravity), 6):
        start = rest + 30.0 * compiled._response(rest, load)  # far, so that some need damping
        for steps in (12, 13):
            found = compiled.contacts.compiled.reach(gravity, load, start, size, steps, NO_DEADLINE)
            goal = Goal(gravity, push=load)
            u, left, taken = newton_steps(python.contacts, goal, start, size, steps, NO_DEADLINE)
            assert found[4] == taken
            if left > size:
                assert found[2] == pytest.approx(left, rel=1e-3)
            else:
                np.testing.assert_allclose(found[0], u, rtol=0, atol=1e-5 * np.abs(u).max())
            ends.append(taken)
    assert all(few <= more for few, more in zip(ends[::2], ends[1::2], strict=True))
    assert ends[::2] != ends[1::2] or block.geometry.count == 1  # one body alone needs no damping here


def random_springs(rng: np.random.Generator, count: int) -> Array:
    """(count, 3, 6) wrenches of unit forces along three directions at right angles, at random places."""
    frames = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    return np.concatenate([frames, np.cross(rng.normal(size=(count, 1, 3)), frames)], axis=2)


def test_an_order_of_elimination_solves_what_a_dense_solver_solves() -> None:
    """Bodies of a ring, a star and the ground, in an order that fills."""
    rng = np.random.default_rng(3)
    sides = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 0], [0, 5], [0, 6], [5, -1], [6, 3], [-1, 2]])
    order = Elimination.of(sides, 7)
    springs = np.arange(len(sides) + 1)
    wrenches, stiffness = random_springs(rng, len(sides)), rng.uniform(1.0, 2.0, len(sides))
    kernel = CompiledElastic(order.compiled, springs, wrenches, stiffness, stiffness, catch=0.1, slack=0.0)
    whole = 0.1 * np.eye(42)
    for (first, second), wrench, k in zip(sides, wrenches, stiffness, strict=True):
        row = np.zeros((3, 42))
        for body, sign in ((first, -1), (second, 1)):
            if body >= 0:
                row[:, 6 * body : 6 * body + 6] = sign * wrench
        whole += k * row.T @ row
    push = rng.normal(size=42)
    found = np.empty(42)
    found[order.entries] = kernel.response(None, push[order.entries])
    np.testing.assert_allclose(found, np.linalg.solve(whole, push), rtol=1e-9)


def test_pairs_that_are_open_couple_nothing() -> None:
    """Bodies of a grid at random displacements: an order for the pairs that press solves what a dense solver solves."""
    rng = np.random.default_rng(8)
    grid = np.arange(70).reshape(10, 7)
    pairs = [(grid[:, :-1], grid[:, 1:]), (grid[:-1], grid[1:]), (np.full(7, -1), grid[0])]
    sides = np.concatenate([np.stack([first.ravel(), second.ravel()], axis=1) for first, second in pairs])
    order = Elimination.of(sides, 70)
    springs, wrenches = np.arange(len(sides) + 1), random_springs(rng, len(sides))
    stiffness, friction = rng.uniform(1.0, 2.0, len(sides)), np.full(len(sides), 1e9)
    kernel = CompiledElastic(order.compiled, springs, wrenches, stiffness, friction, catch=0.1, slack=0.0)
    at, whole, pressed = rng.normal(size=420), 0.1 * np.eye(420), 0
    for (first, second), wrench, k in zip(sides, wrenches, stiffness, strict=True):
        row = np.zeros((3, 420))
        for body, sign in ((first, -1), (second, 1)):
            if body >= 0:
                row[:, 6 * body : 6 * body + 6] = sign * wrench
        if row[0] @ at <= 0:
            whole, pressed = whole + k * row.T @ row, pressed + 1
        elif first < 0:
            whole += 1e-9 * k * np.outer(row[0], row[0])
    assert 0.4 * len(sides) < pressed < 0.6 * len(sides)
    push, found = rng.normal(size=420), np.empty(420)
    found[order.entries] = kernel.response(at[order.entries], push[order.entries])
    np.testing.assert_allclose(found, np.linalg.solve(whole, push), rtol=0, atol=1e-6 * np.abs(found).max())


def test_arrays_of_other_shapes_are_refused() -> None:
    bodies: CompiledBodies = Elimination.of(np.array([[-1, 0]]), 1).compiled
    with pytest.raises(InputError):
        CompiledElastic(bodies, np.array([0, 2]), np.ones((1, 3, 6)), np.ones(2), np.ones(2), catch=1.0, slack=0.0)
