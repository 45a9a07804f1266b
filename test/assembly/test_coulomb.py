"""Elastic contacts with Coulomb friction: closed forms, and what limit analysis wrongly allows."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import G, box, on_floor
from test_equilibrium import slope

from poise.assembly import Analysis, Assembly, Box, Mesh, Push, RigidObject, assess
from poise.assembly.statics import Deadline
from poise.assembly.statics.coulomb import CoulombBlock
from poise.assembly.statics.elastic_state import ElasticState
from poise.geometry import Pose, rotation_of_quaternion


def settled(assembly):
    return [block.solvers.coulomb.settle(block.geometry.gravity.ravel()) for block in Analysis.of(assembly).blocks]


@pytest.mark.parametrize("friction", [0.2, 0.6])
def test_a_cube_stays_on_a_slope_up_to_the_friction_angle(friction):
    limit = np.degrees(np.arctan(friction))
    assert settled(slope(limit - 0.2, friction))[0].stands
    assert not settled(slope(limit + 0.2, friction))[0].stands


@pytest.mark.parametrize(
    ("point", "expected"),
    [((-0.5, 0, 0.2), 0.5 * G), ((-0.5, 0, 1.0), 0.5 * G), ((-0.5, 0.0, 0.6), 0.5 * G)],
)
def test_pushes_through_the_middle_are_held_as_by_hand(point, expected):
    found = assess(scenes.cube(), [Push("cube", point, (1, 0, 0))], "coulomb").results[0]
    assert found.robustness == pytest.approx(expected, rel=0.005)


def test_lifting_topples_as_by_hand():
    found = assess(scenes.cube(), [Push("cube", (0.3, 0, 1), (0, 0, 1))], "coulomb").results[0]
    assert found.robustness == pytest.approx(G / 1.6, rel=0.005)


def test_it_never_holds_more_than_limit_analysis_allows():
    rng = np.random.default_rng(0)
    table = Analysis.of(scenes.table())
    pushes = [
        Push("slab", (-1, y, z), (1, *rng.normal(0, 0.2, 2))) for y, z in rng.uniform([-0.5, 1], [0.5, 1.2], (8, 2))
    ]
    elastic, limit = (assess(table, pushes, model).results for model in ("coulomb", "limit"))
    for a, b in zip(elastic, limit, strict=True):
        assert a.robustness <= b.robustness * 1.003


def test_a_keystone_that_its_weight_wedges_stands_and_one_that_nothing_presses_does_not():
    """A wedge between fixed cheeks that lean outward is pressed by its own weight; between parallel ones it is not."""
    lean = np.radians(20)
    cheeks = []
    for sign in (1, -1):
        normal = np.array([-sign * np.cos(lean), 0, np.sin(lean)])
        centre = np.array([sign * 0.5, 0, 0]) - 0.25 * normal
        quaternion = scenes.turned((0, sign, 0), -70)
        cheeks.append(scenes.fixed_box(f"cheek{sign}", (3, 3, 0.5), centre, quaternion))
    spread = 0.4 * np.tan(lean)
    corners = [
        (x, y, -0.4)
        for x, y in ((-0.5 + spread, -0.3), (0.5 - spread, -0.3), (0.5 - spread, 0.3), (-0.5 + spread, 0.3))
    ]
    corners += [
        (x, y, 0.4) for x, y in ((-0.5 - spread, -0.3), (0.5 + spread, -0.3), (0.5 + spread, 0.3), (-0.5 - spread, 0.3))
    ]
    wedge = scenes.RigidObject("wedge", scenes.shells(scenes.hexahedron(corners)), scenes.pose((0, 0, 0)), mass=1)
    assert settled(scenes.Assembly((*cheeks, wedge), scenes.GRAVITY, 0.1))[0].stands
    assert not settled(scenes.between_walls(with_floor=False, friction=2.0))[0].stands
    assert settled(scenes.between_walls(with_floor=True, friction=2.0))[0].stands


def test_a_brick_pulled_from_under_a_wall_is_held_by_less_than_the_best_that_limit_analysis_can_imagine():
    """Its upper neighbours rest on two bricks each; limit analysis puts all their weight on the one that is pulled."""
    wall = Analysis.of(scenes.wall(4, 3))
    push = [Push("b0_2", (0.1, 0, 0.05), (1, 0, 0))]
    limit = assess(wall, push, "limit").results[0].robustness
    found = assess(wall, push).results[0]
    assert found.checked
    assert found.robustness < 0.9 * limit
    assert found.upper == pytest.approx(limit)


def test_a_loose_block_beside_a_stack_takes_no_load():
    """Touching sides press only when something pushes."""
    pair = on_floor(box("a", (1, 1, 1), (0, 0, 0.5)), box("b", (1, 1, 1), (1, 0, 0.5)))
    found = assess(pair, [Push("a", (0.5, 0, 0.9), (0, 0, 1)), Push("a", (-0.5, 0, 0.2), (1, 0, 0))], "coulomb").results
    assert found[1].robustness == pytest.approx(2 * 0.5 * G, rel=0.01)


def test_rounds_of_friction_bounds_end_with_the_deadline(monkeypatch):
    """Newton is stuck at once; the deadline passes in the first round of Tresca problems."""

    @dataclass(frozen=True)
    class Ticking(Deadline):
        left: list[int] = field(default_factory=lambda: [6])

        @property
        def passed(self):
            self.left[0] -= 1
            return self.left[0] < 0

    block = Analysis.of(scenes.wall(4, 3)).blocks[0]
    coulomb, clock, late = block.solvers.coulomb, Ticking(), []
    stuck = ElasticState(False, 1.0, np.zeros(6 * block.geometry.count), settled=False)
    monkeypatch.setattr(coulomb, "_newton", lambda *_: stuck)
    monkeypatch.setattr(coulomb.contacts, "compiled", None)
    jacobian = coulomb.contacts.jacobian
    monkeypatch.setattr(
        coulomb.contacts, "jacobian", lambda *given: (late.append(clock.left[0] < 0), jacobian(*given))[1]
    )
    # Sideways by a tenth of the weight: much slips.
    load = block.geometry.gravity.copy()
    load[:, 0] += 0.1
    found = coulomb.settle(load.ravel(), deadline=clock)
    assert not found.known
    assert not found.stands
    assert late
    assert not any(late)


def test_a_box_that_leans_on_the_edge_of_another_creeps_to_where_it_stands(monkeypatch):
    """Two boxes as they came to rest in MuJoCo. Newton steps from afar are stuck there with any friction."""
    turns = [(-0.789049, 0.482172, -0.198502, 0.324822), (-0.8940949, -0.4478776, -3e-06, 2e-06)]
    places = [(0.123645, 0.069947, 0.046668), (0.0653988, 0.0049827, 0.029757)]
    sizes = [(0.0782833, 0.0499995, 0.0818706), (0.0557448, 0.0560818, 0.0595185)]
    boxes = [
        box(f"box{i}", size, place, mass=mass, quaternion=turn)
        for i, (size, place, turn, mass) in enumerate(zip(sizes, places, turns, (0.808, 1.745), strict=True))
    ]
    found = Analysis.of(on_floor(*boxes)).stability()
    assert found.stable
    assert found.margin > 0.01
    monkeypatch.setattr(CoulombBlock, "_crept", lambda *_: None)
    stuck = Analysis.of(on_floor(*boxes)).stability()
    assert stuck.doubtful
    assert not stuck.stable
    assert not stuck.falling


def leaning_pile():
    """Three bodies that lean on each other in a bin, and a fourth, as they came to rest in MuJoCo."""
    content = json.loads((Path(__file__).parent / "leaning_pile.json").read_text(encoding="utf-8"))
    objects = []
    for each in content["objects"]:
        mesh = "vertices" in each
        shape = Mesh(np.array(each["vertices"]), np.array(each["triangles"])) if mesh else Box(tuple(each["box"]))
        place, turn = np.split(np.array(each["pose"]), [3])
        pose = Pose(rotation_of_quaternion(turn), place)
        objects.append(RigidObject(each["id"], shape, pose, "mass" not in each, each.get("mass", 0.0)))
    return Assembly(tuple(objects), np.array(content["gravity"]), content["friction"])


def test_bodies_that_rounds_throw_far_away_creep_to_where_they_stand(monkeypatch):
    """Tresca problems of the first rounds seem to fall, where the pile stands with a little more or less friction."""
    pile = leaning_pile()
    margins = [
        Analysis.of(Assembly(pile.objects, pile.gravity, share * pile.friction)).stability().margin
        for share in (0.98, 1.0, 1.02)
    ]
    assert margins == sorted(margins)
    assert margins[0] > 0.1
    monkeypatch.setattr(CoulombBlock, "_crept", lambda *_: None)
    stuck = Analysis.of(pile).stability()
    assert stuck.doubtful, "rounds that diverge do not show that a pile falls"
    assert not stuck.stable
    assert not stuck.falling


def test_a_table_on_an_incline_that_is_too_steep_falls_without_doubt():
    """Elastic contacts show it alone: the bodies creep down."""
    table = scenes.table()
    for friction, tilt in ((0.5, 0.6), (0.3, 0.4)):
        gravity = 9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
        for block in Analysis.of(Assembly(table.objects, gravity, friction)).blocks:
            state = block.solvers.coulomb.settle(block.geometry.gravity.ravel())
            assert state.known
            assert not state.stands
