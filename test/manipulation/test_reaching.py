"""Ways that Reach finds keep their distances by coal, within limits, and straight; and what it refuses, cannot be."""

from itertools import islice, pairwise
from pathlib import Path

import coal
import numpy as np
import pytest

from poise.assembly import Analysis, Assembly, Box, Cylinder, RigidObject, assess, load_scene
from poise.errors import ErrorCode, NoAnswerError
from poise.geometry import Pose
from poise.manipulation import Arm, Reach
from poise.manipulation.approach import _confirmed, _least, _touches, approach_directions
from poise.manipulation.bodies import geometry_of, se3_of
from poise.manipulation.carrying import ROOMY
from poise.manipulation.inverse import LARGEST_JOINT_STEP
from poise.manipulation.reach import NARROW, TOUCHING, UTMOST

TABLE = RigidObject("table", Box((1.2, 1.6, 0.1)), Pose.from_vector([0.4, 0, -0.05, 0, 0, 0, 1]), fixed=True)
SCENES = Path(__file__).resolve().parents[2] / "docs" / "scenes" / "placement"


LEANING = Pose.from_vector([0.374895, -0.449198, 0.088388, 0.421374, 0.822191, -0.174539, 0.340562])


def block(name, size, position, mass=0.3):
    return RigidObject(name, Box(tuple(map(float, size))), Pose.from_vector([*position, 0, 0, 0, 1]), mass=mass)


def can_at(*position):
    return RigidObject("can", Cylinder(0.03, 0.1), Pose.from_vector([*position, 0, 0, 0, 1]), mass=0.3)


NEIGHBOURS = (
    block("tower", (0.04, 0.04, 0.2), (0.5, 0.26, 0.1)),
    block("brick", (0.1, 0.05, 0.05), (0.42, -0.32, 0.025)),
)


@pytest.fixture(scope="module")
def reach():
    return Reach(Arm.load("fr3"), Analysis.of(Assembly((TABLE, *NEIGHBOURS))), can_at(0.4, -0.4, 0.05))


def apart(first, at_first, item):
    """m between a shape and an object; not positive where they touch."""
    places = [coal.Transform3s(place.rotation, place.translation) for place in (at_first, se3_of(item.pose))]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return coal.distance(first, places[0], geometry_of(item.shape), places[1], request, result)


def moving_shapes(arm, q, opening):
    """Fingers and links without the column on which the arm stands."""
    still = sum(shape.parentJoint <= 1 for shape in arm.geometry.geometryObjects)
    return arm.shapes(q, opening)[still:]


@pytest.mark.parametrize("margins", [NARROW, ROOMY])
def test_the_arm_is_free_at_both_ends_and_on_the_straight_ways(reach, margins):
    placed = can_at(0.5, 0.18, 0.05)  # 3 cm beside the tower
    after = reach.before.with_object(placed)
    found = list(islice(reach.all_ends(after, placed, margins), 3))
    assert found
    arm, around = reach.arm, reach.around
    for ends in found:
        width = ends.grasp.width
        for end, item in ((ends.pick, reach.item), (ends.place, placed)):
            np.testing.assert_array_equal(end.hand_away[0], end.object_away[0])
            grasped = se3_of(item.pose) * ends.grasp.object_tcp
            np.testing.assert_allclose(arm.tool(end.hand_away[0]).homogeneous, grasped.homogeneous, atol=1e-5)
            for way in (end.hand_away, end.object_away):
                assert np.all((way >= arm.lower) & (way <= arm.upper))
                assert all(np.abs(b - a).max() <= LARGEST_JOINT_STEP for a, b in pairwise(way))
                away = np.array([arm.tool(q).translation for q in way]) - grasped.translation
                np.testing.assert_allclose(np.cross(away, away[-1]), 0, atol=1e-6)
            for q in end.hand_away:
                shapes = moving_shapes(arm, q, arm.hand.opening(width))
                nearest = min(apart(*one, other) for one in shapes for other in (*around, item))
                assert nearest > margins[0] - 1e-4
            for q in end.object_away[1:]:
                held = arm.tool(q) * ends.grasp.object_tcp.inverse()
                assert np.linalg.norm(held.translation - item.pose.translation) > TOUCHING - 1e-6
                assert min(apart(geometry_of(item.shape), held, other) for other in around) > margins[1] - 1e-4
                shapes = moving_shapes(arm, q, width)
                assert min(apart(*one, other) for one in shapes for other in around) > margins[0] - 1e-4


def test_a_place_counts_only_with_a_grasp_that_also_picks_it_up():
    """Walls around the bar leave the hand only from above; a shelf over the place forbids just that."""
    bar, place = (block("bar", (0.04, 0.04, 0.25), (*at, 0.125)) for at in ((0.4, -0.4), (0.5, 0.1)))
    walls = [block(f"wall {k}", (0.3, 0.02, 0.24), (0.4, -0.4 + 0.09 * k, 0.12)) for k in (-1, 1)]
    ends = [block(f"end {k}", (0.02, 0.15, 0.24), (0.4 + 0.09 * k, -0.4, 0.12)) for k in (-1, 1)]
    shelf = RigidObject("shelf", Box((0.3, 0.3, 0.02)), Pose.from_vector([0.5, 0.1, 0.27, 0, 0, 0, 1]), fixed=True)
    arm, fits = Arm.load("fr3"), {}
    for walled, covered in ((True, False), (False, True), (True, True)):
        around = (*((*walls, *ends) if walled else ()), *((shelf,) if covered else ()))
        reach = Reach(arm, Analysis.of(Assembly((TABLE, *around))), bar)
        assert reach.can_pick()
        fits[walled, covered] = reach.fits_hand(place)
    assert fits == {(True, False): True, (False, True): True, (True, True): False}


def test_what_cannot_be_picked_up_is_said_before_places_are_looked_for():
    boards = [block(f"board {k}", (0.02, 0.2, 0.14), (0.4 + 0.045 * k, -0.4, 0.07)) for k in (-1, 1)]
    sides = [block(f"side {k}", (0.06, 0.02, 0.14), (0.4, -0.4 + 0.045 * k, 0.07)) for k in (-1, 1)]
    arm, can = Arm.load("fr3"), can_at(0.4, -0.4, 0.05)
    with pytest.raises(NoAnswerError) as error:
        Reach(arm, Analysis.of(Assembly((TABLE, *boards, *sides))), can).require_pick()
    assert (error.value.code, error.value.data["step"]) == (ErrorCode.UNREACHABLE, "grasping")
    Reach(arm, Analysis.of(Assembly((TABLE,))), can).require_pick()


def test_what_leans_away_from_the_arm_is_picked_up_with_more_effort():
    """Two steps of a stair and an edge on the table: the few grasps that are left open point back at the arm."""
    stair = next(item for item in load_scene(SCENES / "glued_j.yaml").objects if not item.fixed)
    leaning = RigidObject(stair.id, stair.shape, LEANING, mass=stair.mass)
    reach = Reach(Arm.load("fr3"), Analysis.of(Assembly((TABLE,))), leaning)
    assert reach._effort == UTMOST
    reach.require_pick()


def test_directions_are_judged_together_as_one_by_one(reach):
    placed = can_at(0.5, 0.2, 0.05)
    found = approach_directions(reach.before, reach.before.with_object(placed), placed)
    directions = [direction for direction, _ in found]
    alone = [
        _confirmed(reach.before, _touches(reach.before, placed, direction), *_least(reach.before, placed, [direction]))
        for direction in directions
    ]
    np.testing.assert_allclose([value for _, value in found], alone, rtol=1e-6)
    assert 0 < min(alone) < max(alone)


def test_an_approach_does_not_count_on_what_stands_beside_its_neighbour():
    """Two bricks side by side near the edges of a post: dragged along, the outer one topples as if it were alone."""
    post = RigidObject("post", Box((0.206, 0.5, 0.1)), Pose.from_vector([0, 0, -0.05, 0, 0, 0, 1]), fixed=True)
    shelf = RigidObject("shelf", Box((0.1, 0.5, 0.1)), Pose.from_vector([-0.3, 0, -0.05, 0, 0, 0, 1]), fixed=True)
    before = Analysis.of(
        Assembly((post, shelf, *(block(f"b{x}", (0.2, 0.1, 0.1), (0.1 * x, 0, 0.05)) for x in (-1, 1))))
    )
    placed = block("placed", (0.08, 0.08, 0.1), (-0.26, 0, 0.05))
    every = approach_directions(before, before.with_object(placed), placed)
    assert every
    for direction, value in every:
        pushes = _touches(before, placed, direction)
        held = min((result.lower for result in assess(before, pushes).results), default=np.inf)
        assert value <= 1.05 * held
    few = approach_directions(before, before.with_object(placed), placed, 3)
    assert [value for _, value in few] == [value for _, value in every[:3]]
