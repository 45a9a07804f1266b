"""Rolling against closed forms: flats, inclines, chocks, grooves; what may roll is named; frames do not matter."""

from dataclasses import replace

import assembly_scenes as scenes
import numpy as np
import pytest
import rolling_scenes as rolls
from assembly_scenes import G
from rolling_scenes import R
from scipy.spatial.transform import Rotation

from benchmarks import growth
from poise.assembly import (
    Analysis,
    Assembly,
    Box,
    FrictionPair,
    Push,
    RigidObject,
    Sphere,
    acceleration_limits,
    assess,
    robustness_map,
)
from poise.assembly.robustness import balance_findings, rolling_findings
from poise.assembly.scene import ROLLING
from poise.assembly.statics import ROLLING_TOGETHER, Deadline, rolling
from poise.assembly.statics.rolling import _null_space as null_space
from poise.geometry import Pose, rotation_about

X = np.array([[1.0, 0, 0]])
BETWEEN = np.cos(np.pi / 8)  # around a point the resistance of the octagon is this much less between its corners


def limit(assembly, direction=X):
    return float(acceleration_limits(assembly, direction, turning=False).limits[0])


def pushed(assembly, name, point, direction=(1, 0, 0)):
    return assess(assembly, [Push(name, point, direction)]).results[0]


@pytest.mark.parametrize("kind", ["can", "ball"])
@pytest.mark.parametrize("coefficient", [ROLLING, 0.02])
def test_a_round_body_on_a_floor_rolls_at_the_coefficient_times_its_weight(kind, coefficient):
    assembly = replace(scenes.on_floor(rolls.KINDS[kind]()), rolling=coefficient)
    found = pushed(assembly, kind, (-R, 0, R))
    assert found.robustness == pytest.approx(coefficient * G, rel=1e-6)
    assert (found.mode, found.moves) == ("roll", (kind,))
    assert limit(assembly) == pytest.approx(coefficient * G, rel=1e-6)


def test_a_push_at_the_top_needs_half_the_force_and_a_cylinder_slides_along_its_axis():
    assembly = scenes.on_floor(rolls.can())
    assert pushed(assembly, "can", (0, 0, 2 * R)).robustness == pytest.approx(ROLLING * G / 2, rel=1e-6)
    along = pushed(assembly, "can", (0, -0.1, R), (0, 1, 0))
    assert (along.mode, along.robustness) == ("slip", pytest.approx(0.5 * G, rel=1e-6))
    assert limit(assembly, np.array([[0, 1.0, 0]])) == pytest.approx(0.5 * G, rel=1e-6)


@pytest.mark.parametrize("kind", ["can", "ball"])
@pytest.mark.parametrize("azimuth", [0.0, 22.5])
def test_on_an_incline_it_holds_up_to_the_angle_whose_tangent_is_the_coefficient(kind, azimuth):
    for share, stands in ((0.97 * BETWEEN if azimuth and kind == "ball" else 0.99, True), (1.02, False)):
        tangent = share * 0.02 / (np.cos(np.radians(azimuth)) if kind == "can" else 1)
        down = np.append(tangent * np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))]), -1)
        assembly = replace(scenes.on_floor(rolls.KINDS[kind]()), gravity=G * down, rolling=0.02)
        assert Analysis.of(assembly).stability().stable == stands


@pytest.mark.parametrize("kind", ["can", "ball"])
@pytest.mark.parametrize("height", [0.1 * R, 0.3 * R, 0.7 * R])
def test_between_chocks_it_climbs_over_an_edge_at_the_closed_form(kind, height):
    """About the edge of height h: F (r - h) = m g sqrt(r^2 - (r - h)^2)."""
    assembly = scenes.on_floor(rolls.KINDS[kind](), *rolls.chocks(height), friction=2.0)
    expected = G * np.sqrt(R**2 - (R - height) ** 2) / (R - height)
    found = pushed(assembly, kind, (-R, 0, R))
    assert found.robustness == pytest.approx(expected, rel=0.005)
    assert found.mode == "topple"
    assert limit(assembly) == pytest.approx(expected, rel=0.005)
    assert not rolling(Analysis.of(assembly))


@pytest.mark.parametrize("kind", ["can", "ball"])
@pytest.mark.parametrize(("degrees", "friction"), [(10, 0.5), (30, 0.5), (45, 0.5), (45, 1.5), (60, 1.0)])
def test_in_a_groove_it_is_held_up_to_gravity_times_the_slope(kind, degrees, friction):
    """Also where the walls are steeper than friction, so that all contacts slip when it is put down.

    On one wall alone, rolling resistance may hold it a little longer.
    """
    found, slope = limit(rolls.groove(degrees, friction, rolls.KINDS[kind])), np.tan(np.radians(degrees))
    assert 0.995 * G * slope <= found <= 1.005 * G * (slope + ROLLING * (1 + slope**2))


def test_a_ball_rolls_along_a_groove_and_a_cylinder_does_not():
    scene = {kind: rolls.groove(30, body=body) for kind, body in rolls.KINDS.items()}
    assert not rolling(Analysis.of(scene["can"]))
    assert [found.objects for found in rolling(Analysis.of(scene["ball"]))] == [("ball",)]
    # Both walls press by m g / (2 cos a) at a lever of ROLLING R; the ball turns about a line R cos a below its centre.
    along = pushed(scene["ball"], "ball", (0, -R, R / np.cos(np.pi / 6)), (0, 1, 0))
    assert along.robustness == pytest.approx(ROLLING * G / np.cos(np.pi / 6), rel=0.03)


def test_a_ball_on_a_ball_rolls_at_half_the_resistance():
    """The radius that counts is 1 / (1 / R + 1 / R)."""
    low = RigidObject("low", Sphere(R), scenes.pose((0, 0, R)), fixed=True)
    assembly = scenes.on_floor(low, rolls.ball(z=3 * R))
    assert pushed(assembly, "ball", (-R, 0, 3 * R)).robustness == pytest.approx(ROLLING * G / 2, rel=1e-6)


def test_a_pair_has_its_own_resistance_and_without_any_the_least_push_rolls():
    pair = FrictionPair(("floor", "can"), 0.5, rolling=0.1)
    assert limit(scenes.on_floor(rolls.can(), pairs=[pair])) == pytest.approx(0.1 * G, rel=1e-6)
    bare = replace(scenes.on_floor(rolls.can(), rolls.ball(x=0.5)), rolling=0.0)
    assert limit(bare) == pytest.approx(0.0, abs=1e-9)
    assert [found.objects for found in rolling(Analysis.of(bare))] == [("can",), ("ball",)]
    changed = Analysis.of(scenes.on_floor(rolls.can())).with_object(pairs=[pair])
    assert limit(changed) == pytest.approx(0.1 * G, rel=1e-6)


CASES = {
    "a marble": (lambda: scenes.on_floor(rolls.ball()), [(("ball",), "neutral")]),
    "a can that stands": (lambda: scenes.on_floor(scenes.cylinder("can", R, 0.2, (0, 0, 0.1))), []),
    "one chock": (lambda: scenes.on_floor(rolls.can(), *rolls.chocks(0.01, sides=(1,))), [(("can",), "neutral")]),
    "chocks with gaps": (lambda: scenes.on_floor(rolls.can(), *rolls.chocks(0.01, 0.005)), [(("can",), "neutral")]),
    "low centre of mass": (lambda: scenes.on_floor(rolls.ball(com=np.array([0, 0, -0.02]))), [(("ball",), "stable")]),
    "on a ball": (
        lambda: scenes.on_floor(rolls.ball("low"), rolls.ball(z=3 * R)),
        [(("ball",), "unstable"), (("low", "ball"), "unstable")],
    ),
    "a board on rollers": (
        lambda: scenes.on_floor(
            rolls.can("a", -0.2), rolls.can("b", 0.2), scenes.box("board", (0.8, 0.2, 0.02), (0, 0, 2 * R + 0.01))
        ),
        [(("a", "b", "board"), "neutral")],
    ),
    "three balls and a wall": (
        lambda: scenes.on_floor(
            *(rolls.ball(f"b{i}", 2 * R * i) for i in range(3)),
            scenes.fixed_box("wall", (0.02, 1, 1), (-R - 0.01, 0, 0.5)),
        ),
        [(("b0", "b1", "b2"), "neutral")],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_what_may_roll_is_named_with_its_kind_of_equilibrium(case):
    scene, expected = CASES[case]
    analysis = Analysis.of(scene())
    assert analysis.stability().stable
    found = rolling(analysis)
    assert [(each.objects, each.equilibrium) for each in found] == expected
    assert len(rolling_findings(analysis)) == len(expected)
    for each in found:
        # The force that it names starts it.
        if np.isfinite(each.force) and len(each.objects) == 1:
            item = analysis.assembly.objects[analysis.assembly.index[each.objects[0]]]
            aside = R if item.com is None else np.sqrt(R**2 - item.com[2] ** 2)
            push = Push(item.id, item.com_in_world - [aside, 0, 0], (1, 0, 0))
            assert assess(analysis, [push]).results[0].robustness == pytest.approx(each.force, rel=1e-6)


@pytest.mark.parametrize("kind", ["can", "ball"])
@pytest.mark.parametrize("share", [-0.9, -0.5, 0.5, 0.9])
@pytest.mark.parametrize(("azimuth", "com"), [(0.0, 0.0), (10.0, 0.0), (22.5, 0.0), (0.0, 0.01)])
def test_the_force_that_starts_it_downhill_is_that_of_a_push(kind, share, azimuth, com):
    along = np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth)), 0.0])
    body = rolls.KINDS[kind](com=np.array([0, com, 0] if kind == "can" else [0, 0, com]))
    tangent = share * 0.02 * (BETWEEN if kind == "ball" else 1 / along[0]) * R / (R + com)
    assembly = replace(scenes.on_floor(body), gravity=G * (tangent * along - [0, 0, 1]), rolling=0.02)
    (found,) = rolling(analysis := Analysis.of(assembly))
    downhill = np.sign(share) * (along if kind == "ball" else np.array([1.0, 0, 0]))
    point = body.com_in_world - np.sqrt(R**2 - com**2) * downhill
    push = Push(kind, point, downhill)
    assert found.force == pytest.approx(assess(analysis, [push]).results[0].robustness, rel=1e-3)
    assert found.force < 0.6 * 0.02 * G


def test_the_null_space_of_many_rows_takes_little_memory():
    rows = np.zeros((200_000, 6))
    rows[1000:1003, :3] = np.eye(3)
    rows[5000:5100] = [1.0, 2.0, 3.0, 1.0, 0.0, 0.0]
    free = null_space(rows)  # a full decomposition would have 300 GB
    assert np.abs(rows @ free).max() < 1e-9
    np.testing.assert_allclose(free.T @ free, np.eye(2), atol=1e-12)


def test_a_deadline_ends_the_search_for_what_rolls():
    analysis = Analysis.of(scenes.on_floor(rolls.can(), rolls.ball(x=0.5)))
    assert analysis.stability().stable
    assert rolling(analysis, Deadline.after(0.0)) == ()
    assert rolling_findings(analysis, Deadline.after(0.0)) == ()
    assert len(rolling_findings(analysis)) == 2


def test_more_bodies_than_are_asked_together_are_asked_one_by_one():
    row = [rolls.can(f"c{i}", 2 * R * i) for i in range(45)]
    slab = scenes.box("slab", (90 * R, 0.2, 0.02), (44 * R, 0, 2 * R + 0.01))
    analysis = Analysis.of(scenes.on_floor(row[0], row[-1], slab))
    assert {name for found in rolling(analysis) for name in found.objects} == {"c0", "c44", "slab"}
    apart = Analysis.of(
        scenes.on_floor(
            *(
                replace(item, pose=Pose(item.pose.rotation, 1.2 * item.pose.translation * [1, 1, 1 / 1.2]))
                for item in row
            )
        )
    )
    assert len(rolling(apart)) == 45


@pytest.mark.parametrize("seed", range(4))
def test_answers_do_not_depend_on_the_frame_the_scale_or_the_order(seed):
    rng = np.random.default_rng(seed)
    base = scenes.on_floor(rolls.ball(), rolls.can("can", 0.4), *rolls.chocks(0.01, sides=(1,)))
    turn, shift, scale = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3), float(rng.uniform(0.5, 3))
    moved = []
    for item in rng.permutation(np.array(base.objects, dtype=object)):
        shape = replace(
            item.shape,
            **{
                key: np.multiply(getattr(item.shape, key), scale)
                if key != "size"
                else tuple(scale * side for side in item.shape.size)
                for key in item.shape.__dataclass_fields__
            },
        )
        place = Pose(turn @ item.pose.rotation, scale * (turn @ item.pose.translation) + shift)
        moved.append(replace(item, shape=shape, pose=place))
    other = Assembly(tuple(moved), turn @ scenes.GRAVITY)
    ways = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0]])
    for way in ways:
        for name in ("can", "ball"):
            alone, same = (
                base.without("ball" if name == "can" else "can"),
                other.without("ball" if name == "can" else "can"),
            )
            before, after = limit(alone, way[None]), limit(same, (turn @ way)[None])
            # A ball's octagon is turned by another frame.
            assert after == pytest.approx(before, rel=0.1 if name == "ball" else 0.01)
    assert sorted(found.objects for found in rolling(Analysis.of(other))) == [("ball",), ("can",)]


def test_a_map_of_a_ball_agrees_with_single_pushes():
    analysis = Analysis.of(replace(scenes.on_floor(rolls.ball()), rolling=0.02))
    found = robustness_map(analysis, 200, 0.05)
    picked = range(0, len(found.lower), 23)
    pushes = [Push("ball", found.surface.points[i], found.surface.directions[i]) for i in picked]
    single = np.array([each.robustness for each in assess(analysis, pushes).results])
    assert np.all(found.lower[picked] <= single * (1 + 1e-6))
    assert np.all(single <= found.upper[picked] * (1 + 1e-6))


def many_beside_a_board_on_rollers(count):
    """Bricks of a wall that all touch, and beside them a board on two rollers that touches the wall's end."""
    wall = growth.wall(count)
    end = max(item.vertices[:, 0].max() for item in wall.objects if not item.fixed)
    axis = scenes.turned((1, 0, 0), 90)
    rollers = [
        scenes.cylinder(f"roller{k}", 0.05, 0.1, (end + x, 0, 0.05), quaternion=axis) for k, x in enumerate((0.1, 0.4))
    ]
    board = scenes.box("board", (0.5, 0.1, 0.1), (end + 0.25, 0, 0.15))
    return Assembly((*wall.objects, *rollers, board), scenes.GRAVITY, 0.5)


@pytest.mark.parametrize("count", [10, 44])
def test_what_rolls_together_is_found_in_large_groups_too_and_what_was_not_asked_is_said(count):
    analysis = Analysis.of(many_beside_a_board_on_rollers(count))
    assert max(block.geometry.count for block in analysis.blocks) == count + 3
    assert analysis.stability().stable
    assert {name for found in rolling(analysis) for name in found.objects} == {"roller0", "roller1", "board"}
    sentences = [finding.sentence for finding in rolling_findings(analysis)]
    unasked = [sentence for sentence in sentences if "not looked for" in sentence]
    assert len(unasked) == int(count + 3 > ROLLING_TOGETHER)
    assert any("may roll" in sentence for sentence in sentences)


def test_what_balances_on_an_edge_is_said_and_what_hangs_from_one_is_not():
    """Its margin of pressure is all of its weight, but any push tips it."""
    turned, up = scenes.turned((0, 1, 0), 45), 0.05 * np.sqrt(2)
    on_edge = scenes.on_floor(scenes.box("cube", (0.1,) * 3, (0, 0, up), quaternion=turned))
    (finding,) = balance_findings(Analysis.of(on_edge))
    assert finding.sentence == "cube: balances on an edge or a point; the least push or tilt tips it"
    assert assess(on_edge, [Push("cube", (0, 0, 2 * up), (1, 0, 0))]).results[0].robustness == 0
    ridge = scenes.fixed_box("ridge", (0.1, 0.3, 0.1), (0, 0, -up), quaternion=turned)
    plank = scenes.box("plank", (0.4, 0.1, 0.02), (0, 0, 0.01), com=np.array([0.0, 0.0, -0.1]))
    hung = Assembly((ridge, plank), np.array([0.0, 0.0, -G]), 0.5)
    assert not balance_findings(Analysis.of(hung))
    assert not balance_findings(Analysis.of(scenes.stack(3)))
    assert not balance_findings(Analysis.of(scenes.table()))


@pytest.mark.parametrize(("turn", "com", "balances"), [(45, 0.0, True), (45, -0.1, False), (0, 0.0, False)])
def test_a_bar_that_balances_on_two_blocks_has_a_finding(turn: float, com: float, balances: bool) -> None:
    """On one of its edges, unless its centre of mass is below that; not on a face."""
    blocks = [
        RigidObject(f"block {x:g}", Box((0.1, 0.1, 0.1)), Pose(np.eye(3), np.array([x, 0, 0.05])), fixed=True)
        for x in (-0.2, 0.2)
    ]
    height = 0.1 + 0.05 * (np.sqrt(2) if turn else 1.0)
    pose = Pose(rotation_about(np.array([1.0, 0.0, 0.0]), np.radians(turn)), np.array([0, 0, height]))
    bar = RigidObject("bar", Box((0.6, 0.1, 0.1)), pose, mass=1.0, com=pose.rotation.T @ [0, 0, com])
    found = balance_findings(Analysis.of(Assembly((*blocks, bar), np.array([0, 0, -9.81]), 0.5)))
    assert [finding.sentence.startswith("bar: balances") for finding in found] == [True] * balances
