"""A transfer begins and ends where it has to, touches nothing and holds what it carries; or says why there is none."""

import numpy as np
import pytest

from poise.assembly import Analysis, Assembly, Box, Cylinder, Push, RigidObject, assess
from poise.errors import ErrorCode, NoAnswerError
from poise.geometry import Pose
from poise.manipulation import Arm, Reach, plan_transfer
from poise.manipulation.approach import approach_directions
from poise.manipulation.bodies import se3_of
from poise.manipulation.execution import steps_of
from poise.placement import Options, plan_placement

TABLE = RigidObject("table", Box((1.2, 1.6, 0.1)), Pose.from_vector([0.4, 0, -0.05, 0, 0, 0, 1]), fixed=True)
LYING = [0.4, -0.4, 0.05, 0, 0, 0, 1]


def block(name, size, position, mass=0.3):
    return RigidObject(name, Box(tuple(map(float, size))), Pose.from_vector([*position, 0, 0, 0, 1]), mass=mass)


@pytest.fixture(scope="module")
def carried():
    """A can put on a block by an FR3, with a neighbour beside it."""
    before = Analysis.of(Assembly((TABLE, block("block", (0.2, 0.2, 0.1), (0.5, 0.2, 0.05), 2.0))))
    can = RigidObject("can", Cylinder(0.03, 0.1), Pose.from_vector(LYING), mass=0.3)
    reach = Reach(Arm.load("fr3"), before, can)
    found = plan_placement(before, can, Options(on="objects", tests=reach.tests), 1)
    return reach, found, plan_transfer(reach, found.analysis, found.item, seconds=600.0)


def motions_of(transfer, name):
    (phase,) = [phase for phase in transfer.phases if phase.name == name]
    return phase.motions


def test_hand_and_object_meet_where_it_lies_and_part_where_it_stands(carried):
    reach, found, transfer = carried
    tool = reach.arm.tool
    lying, standing = (se3_of(item.pose) * transfer.grasp.object_tcp for item in (reach.item, found.item))
    for q, pose in (
        (motions_of(transfer, "approach")[-1].position[-1], lying),
        (motions_of(transfer, "lift")[0].position[0], lying),
        (motions_of(transfer, "lower")[-1].position[-1], standing),
        (motions_of(transfer, "retreat")[0].position[0], standing),
    ):
        np.testing.assert_allclose(tool(q).homogeneous, pose.homogeneous, atol=1e-4)


def test_the_motions_join_and_end_where_they_began(carried):
    reach, _, transfer = carried
    motions = [motion for phase in transfer.phases for motion in phase.motions]
    ends = [reach.start, *(motion.position[-1] for motion in motions)]
    for end, motion in zip(ends[:-1], motions, strict=True):
        np.testing.assert_allclose(motion.position[0], end, atol=1e-9)
    np.testing.assert_allclose(ends[-1], reach.start, atol=1e-9)


def test_as_steps_the_fingers_move_between_motions_that_join(carried):
    reach, _, transfer = carried
    steps, width = steps_of(transfer, 0.5), transfer.grasp.width
    wide = reach.arm.hand.opening(width)
    fingers = [(step.opening, step.holding, step.stage) for step in steps if step.motion is None]
    assert fingers == [
        (0.0, False, "picking"),
        (wide, False, "picking"),
        (width, True, "picking"),
        (wide, False, "placing"),
        (0.0, False, "placing"),
    ]
    at = reach.start
    for step in steps:
        if step.motion is not None:
            np.testing.assert_allclose(step.motion.position[0], at, atol=1e-9)
            at = step.motion.position[-1]
    names = [step.name for step in steps if step.motion is not None]
    assert names == [phase.name for phase in transfer.phases]
    seconds = sum(step.motion.duration for step in steps if step.motion is not None)
    assert seconds == pytest.approx(sum(phase.seconds for phase in transfer.phases))


def test_on_the_way_nothing_is_under_the_table_and_the_object_is_not_shaken_loose(carried):
    reach, _, transfer = carried
    com = transfer.grasp.object_tcp.inverse().act(np.zeros(3))
    rim = np.array([[0.03 * np.cos(a), 0.03 * np.sin(a), z] for a in np.linspace(0, 6, 20) for z in (-0.05, 0.05)])
    for phase in transfer.phases:
        for motion in phase.motions:
            step = motion.duration / 500
            tools = [reach.arm.tool(q) for q in motion.at(np.arange(0, motion.duration, step)).position]
            assert min(tool.translation[2] for tool in tools) > 0
            if phase.holding:
                objects = [tool * transfer.grasp.object_tcp.inverse() for tool in tools]
                assert min((rim @ o.rotation.T + o.translation)[:, 2].min() for o in objects) > -1e-4
                points = np.array([tool.act(com) for tool in tools])
                shaken = np.linalg.norm(np.diff(points, 2, axis=0), axis=1).max() / step**2
                assert shaken <= 0.85 * transfer.ends.hold


def test_same_seed_same_motion(carried):
    reach, found, transfer = carried
    again = plan_transfer(Reach(reach.arm, reach.before, reach.item), found.analysis, found.item, seconds=600.0)
    for first, second in zip(transfer.phases, again.phases, strict=True):
        for one, other in zip(first.motions, second.motions, strict=True):
            np.testing.assert_array_equal(one.position, other.position)


def test_a_placement_out_of_reach_or_without_room_is_turned_away_by_name():
    before = Analysis.of(Assembly((TABLE,)))
    item = block("bar", (0.2, 0.12, 0.02), (0.4, -0.4, 0.01))
    # Lying on the table it can be held nowhere; there is no other way for it to lie there.
    reach = Reach(Arm.load("fr3"), before, item)
    with pytest.raises(NoAnswerError) as error:
        plan_placement(before, item, Options(attempts=20, tests=reach.tests))
    assert error.value.code is ErrorCode.NO_PLACEMENT
    assert error.value.data["rejected"]["leaves no room for the hand"] > 0
    far = Reach(
        Arm.load("fr3", Pose.from_vector([-2, 0, 0, 0, 0, 0, 1])), before, block("it", (0.05, 0.05, 0.1), LYING[:3])
    )
    with pytest.raises(NoAnswerError) as error:
        plan_placement(before, far.item, Options(attempts=20, tests=far.tests))
    assert error.value.data["rejected"]["out of the arm's reach"] > 0


def test_a_place_that_no_grasp_serves_says_which_step_failed():
    before = Analysis.of(Assembly((TABLE,)))
    far = block("it", (0.05, 0.05, 0.1), (0.95, 0.75, 0.05))
    reach = Reach(Arm.load("fr3"), before, block("it", (0.05, 0.05, 0.1), LYING[:3]))
    with pytest.raises(NoAnswerError) as error:
        plan_transfer(reach, before.with_object(far), far)
    assert (error.value.code, error.value.data["step"]) == (ErrorCode.UNREACHABLE, "grasping")


def test_an_arm_that_begins_in_something_says_what_touches_what(carried):
    reach, _, _ = carried
    reach.require_free_start()
    there = block("there", (0.05, 0.05, 0.05), reach.arm.tool(reach.start).translation)
    with pytest.raises(NoAnswerError, match="touches object there") as error:
        Reach(reach.arm, reach.before, there).require_free_start()
    assert error.value.code is ErrorCode.INTERPENETRATION


def test_the_approach_spares_the_neighbour_that_falls_easily():
    """A thin tower between a wall and the new place: towards the wall it bears much, away from it next to nothing."""
    wall = RigidObject("wall", Box((0.1, 0.4, 0.3)), Pose.from_vector([0.7, 0, 0.15, 0, 0, 0, 1]), fixed=True)
    tower = block("tower", (0.04, 0.1, 0.25), (0.63, 0, 0.125))
    before = Analysis.of(Assembly((TABLE, wall, tower)))
    item = block("it", (0.06, 0.06, 0.1), (0.57, 0, 0.05))
    found = approach_directions(before, before.with_object(item), item)
    values = [min(value, 50.0) for _, value in found]
    assert values == sorted(values, reverse=True)
    by_x = {float(np.round(direction[0], 3)): value for direction, value in found}
    assert by_x[min(by_x)] < 3.0 < 10.0 < by_x[max(by_x)]
    direction, value = found[-1]
    heights = [Push("tower", np.array([0.61, 0.0, z]), direction) for z in (0.1, 0.01)]
    high, low = (result.lower for result in assess(before, heights).results)
    assert high <= value <= low
    assert all(direction[2] < 0 for direction, _ in found)
