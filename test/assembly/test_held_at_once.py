"""Margins that a few least squares prove, against the conic program; pairs of bodies and points of paths in short."""

from itertools import combinations

import assembly_scenes as scenes
import numpy as np
import pytest

from benchmarks.touching import random_scene
from poise.assembly import Analysis, Assembly
from poise.assembly.contact.contacts import CONTACT_MARGIN, _pairs_near
from poise.assembly.contact.placed import placed
from poise.assembly.robustness import rough_robustness
from poise.assembly.robustness.maps import robustness_map
from poise.assembly.statics.elimination import Elimination, _alone
from poise.assembly.statics.equilibrium import held_at_once, resists
from poise.assembly.statics.load_path import CompiledPoints, LoadPath
from poise.geometry import Pose, rotation_about

FEW = 8


def slope(degrees: float, friction: float, shift: float = 0.0) -> Assembly:
    """A cube on a slope, shifted down along it beyond its edge."""
    angle, turn = np.radians(degrees), scenes.turned((0, 1, 0), degrees)
    along = np.array([np.cos(angle), 0, -np.sin(angle)])
    ramp = scenes.fixed_box("ramp", (20, 20, 1), (0, 0, 0), turn)
    place = np.array([np.sin(angle), 0, np.cos(angle)]) + shift * along
    return Assembly((ramp, scenes.box("cube", (1, 1, 1), place, quaternion=turn)), scenes.GRAVITY, friction)


def overhanging(by: float) -> Assembly:
    """A brick whose centre of mass is so far beyond the edge of what carries it."""
    return scenes.on_floor(scenes.box("low", (1, 1, 1), (0, 0, 0.5)), scenes.box("top", (1, 1, 1), (0.5 + by, 0, 1.5)))


def random_blocks():
    for number in range(8):
        rng = np.random.default_rng([4, number])
        for kind in ("row", "wall", "pallet"):
            yield from Analysis.of(random_scene(kind, rng)).blocks
    for degrees, friction in ((0, 0.5), (20, 0.5), (26, 0.5), (27, 0.5), (40, 0.1), (0, 0.0)):
        yield from Analysis.of(slope(degrees, friction)).blocks
    for by in (-0.49, -0.3, -1e-3, 1e-3, 0.3):
        yield from Analysis.of(overhanging(by)).blocks
    yield from Analysis.of(scenes.between_walls(True)).blocks
    yield from Analysis.of(scenes.table()).blocks


def test_a_margin_that_is_seen_at_once_is_no_more_than_that_of_the_conic_program():
    seen = stand = 0
    for block in random_blocks():
        if block.geometry.count > FEW:
            continue
        found, margin = held_at_once(block.geometry, np.inf), block.solvers.balance.margin
        assert found.margin <= margin + 1e-8
        assert found.everywhere == (np.linalg.matrix_rank(block.geometry.grasp.toarray()) == 6 * block.geometry.count)
        assert resists(block.geometry).everywhere == found.everywhere
        seen, stand = seen + (found.margin > 1e-6), stand + (margin > 1e-6)
    assert seen > 0.3 * stand


@pytest.mark.parametrize("assembly", [slope(27, 0.5), slope(5, 0.0), overhanging(0.01), overhanging(0.3)])
def test_nothing_is_proven_of_what_falls(assembly):
    margins = [held_at_once(block.geometry, 1e-3).margin for block in Analysis.of(assembly).blocks]
    assert min(margins) <= 0
    assert not all(block.solvers.stands_by(1e-3) for block in Analysis.of(assembly).blocks)


def test_a_cube_in_the_middle_is_held_by_a_quarter_of_its_weight_at_each_corner():
    (block,) = Analysis.of(scenes.cube()).blocks
    assert held_at_once(block.geometry, np.inf).margin == pytest.approx(1.0, abs=1e-9)
    assert held_at_once(block.geometry, 1e-3).margin == pytest.approx(block.solvers.balance.margin, abs=1e-7)


@pytest.mark.parametrize("least", [1e-3, 0.05, 0.3, 0.9])
def test_what_stands_by_a_margin_is_what_the_whole_answer_says(least):
    for number in range(6):
        assembly = random_scene("row", np.random.default_rng([5, number]))
        for quick, whole in zip(Analysis.of(assembly).blocks, Analysis.of(assembly).blocks, strict=True):
            standing, known = whole.solvers.standing()
            assert quick.solvers.stands_by(least) == (known and standing.margin >= least)
            assert (quick.solvers.held(least).margin >= least) == (whole.solvers.balance.margin >= least)


def test_what_only_touches_does_not_make_it_stand():
    """Wedged between walls that nothing presses, forces exist at any magnitude; elastic contacts decide."""
    (block,) = Analysis.of(scenes.between_walls(True)).blocks
    assert block.solvers.held(1e-3).margin >= 1e-3
    standing, known = block.solvers.standing()
    assert Analysis.of(scenes.between_walls(True)).blocks[0].solvers.stands_by(1e-3) == (
        known and standing.margin >= 1e-3
    )


def test_the_guide_of_placements_is_near_the_certified_map():
    """Of bodies on one interface it is what patches hold; of others limit analysis, to the tolerance that is asked."""
    for assembly, model, tolerance in ((scenes.stack(3), "patch", 1e-6), (scenes.table(), "limit", 0.1)):
        analysis = Analysis.of(assembly)
        exact = robustness_map(analysis, 300, 0.03, model)
        rough = np.minimum(rough_robustness(analysis, exact.surface, tolerance), 900.0)
        assert np.all(rough >= (1 - tolerance) * np.minimum(exact.lower, 900.0))
        assert np.all(rough <= (1 + tolerance) * np.minimum(exact.upper, 900.0))


def test_pairs_are_those_whose_bounds_meet():
    """All, and those with some bodies, against each pair looked at by itself."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        bodies = []
        for number in range(12):
            where = Pose(rotation_about(rng.normal(size=3), rng.uniform(0, 3)), rng.uniform(-1, 1, 3))
            item = scenes.box(f"b{number}", rng.uniform(0.1, 0.9, 3), (0, 0, 0), fixed=bool(rng.random() < 0.3))
            bodies.append(placed(type(item)(item.id, item.shape, where, mass=1.0, fixed=item.fixed)))
        wanted = np.sort(rng.choice(12, 3, replace=False))
        bounds = [body.bounds for body in bodies]
        for i, j in combinations(range(12), 2):
            both = np.stack([np.maximum(bounds[i][0], bounds[j][0]), np.minimum(bounds[i][1], bounds[j][1])])
            meet = bool(np.all(both[0] <= both[1] + CONTACT_MARGIN))
            meet &= not (bodies[i].item.fixed and bodies[j].item.fixed)
            assert ((i, j) in _pairs_near(bodies, CONTACT_MARGIN)) == meet
        some = [pair for pair in _pairs_near(bodies, CONTACT_MARGIN) if set(pair) & set(wanted.tolist())]
        assert _pairs_near(bodies, CONTACT_MARGIN, wanted) == some


def test_one_body_has_one_order_of_elimination():
    sides = np.array([[-1, 0], [0, -1], [1, 0]])
    found = Elimination.of(sides, 1)
    assert found is _alone(3, (False, True, True, False, False, True))
    assert found.sides.tolist() == [[-1, 0], [0, -1], [-1, 0]]
    assert (found.starts.tolist(), len(found.rows), found.place.tolist()) == ([0, 0], 0, [-1, -1, -1])


def test_points_that_are_made_when_asked_for_are_the_points_of_the_path():
    rng = np.random.default_rng(1)
    entries, factors = rng.permutation(12), [0.0, 0.5, 0.9, 1.4, 1.4, 1.1]
    compiled = CompiledPoints(rng.normal(size=(6, 12)), entries, factors, [1.0] * 6, [3] * 6)
    lazy, plain = LoadPath(compiled, np.zeros(12), True), LoadPath(list(compiled), np.zeros(12), True)
    assert lazy.best is compiled[3]  # paths go on where the best point is another one
    assert compiled[-3] is lazy.best
    assert np.array_equal(compiled[2].displacement[entries], compiled.displacements[2])
    for factor in (-1.0, 0.6, 1.2, 2.0):
        assert lazy.up_to(factor).displacement.tolist() == plain.up_to(factor).displacement.tolist()
    assert lazy.best.displacement.tolist() == plain.best.displacement.tolist() == compiled[3].displacement.tolist()
    assert [point.factor for point in [*compiled[1:3], compiled[-1]]] == [0.5, 0.9, 1.1]
