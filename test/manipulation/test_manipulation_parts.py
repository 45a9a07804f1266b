"""Hand, grasps, inverse kinematics, ways and timing against closed forms and finite differences."""

import time
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from poise.assembly import Box, Cylinder, RigidObject
from poise.assembly.statics.pushes import surface_distance
from poise.geometry import Pose
from poise.manipulation import Arm, Grasp, Hand, Limits
from poise.manipulation.cell import Cell
from poise.manipulation.grasps import antipodal_grasps
from poise.manipulation.inverse import descend, solutions
from poise.manipulation.rrt import find_way, shortened
from poise.manipulation.timing import timed

G = 9.80665
ROBOTS = ("fr3", "xarm7", "ridgeback_ur10")
LATER = 1e9


def block(name, size, position, mass=1.0, fixed=False):
    return RigidObject(name, Box(tuple(map(float, size))), Pose.from_vector([*position, 0, 0, 0, 1]), fixed, mass)


# -- grasps and grip -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [Box((0.05, 0.07, 0.2)), Cylinder(0.03, 0.1)])
def test_the_fingers_of_every_grasp_meet_the_surface_on_both_sides_squarely(shape):
    item = RigidObject("it", shape, Pose(np.eye(3), np.zeros(3)), mass=1.0)
    grasps = antipodal_grasps(shape, Hand())
    assert len(grasps) > 10
    for grasp in grasps:
        rotation = np.array(grasp.object_tcp.rotation)
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        assert grasp.width <= Hand().widest
        middle = grasp.object_tcp.act(np.array([0.0, 0.0, -0.004]))
        pads = [middle + side * grasp.width / 2 * rotation[:, 1] for side in (-1, 1)]
        # A cylinder is grasped at its prism, whose flats are 4e-5 m inside of it.
        assert surface_distance(item, np.array(pads)).max() < 1e-4
        outside = [middle + side * (grasp.width / 2 + 1e-3) * rotation[:, 1] for side in (-1, 1)]
        assert surface_distance(item, np.array(outside)).min() > 9e-4


def test_what_is_too_wide_has_no_grasp():
    assert antipodal_grasps(Box((0.1, 0.1, 0.1)), Hand()) == ()


def test_the_grip_holds_what_its_friction_and_its_torque_bear():
    hand, item = Hand(force=100.0, friction=0.5, pad_radius=0.01), block("it", (0.05, 0.05, 0.2), (3, 2, 1), 2.0)
    centred = pin.SE3(np.eye(3), np.zeros(3))
    assert hand.acceleration_limit(item, centred, G) == pytest.approx(100.0 / 2.0 - G)
    # Along the closing direction a lever does not count; across it does.
    aside = pin.SE3(np.eye(3), np.array([0.0, 0.02, 0.0]))
    assert hand.acceleration_limit(item, aside, G) == pytest.approx(100.0 / 2.0 - G)
    above = hand.acceleration_limit(item, pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.06])), G)
    force = 2.0 * (above + G)
    assert (force / 100.0) ** 2 + (force * 0.06 / (100.0 * 0.01 * 2 / 3)) ** 2 == pytest.approx(1.0)


# -- kinematics ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_pose_that_the_arm_can_take_is_reached_within_its_limits(robot):
    arm, rng = Arm.load(robot, Pose.from_vector([0.3, -0.2, 0.1, 0, 0, 0.6, 0.8])), np.random.default_rng(3)
    reached = 0
    for _ in range(50):
        target = arm.tool(rng.uniform(arm.lower, arm.upper))
        arm.tool(arm.lower)  # nothing of it is left in pinocchio's memory
        found = next(solutions(arm, target, [], rng, 16), None)
        if found is not None:
            assert np.all((found >= arm.lower) & (found <= arm.upper))
            np.testing.assert_allclose(arm.tool(found).homogeneous, target.homogeneous, atol=1e-5)
            reached += 1
    assert reached >= 45


def test_what_is_out_of_reach_is_not_reached():
    arm = Arm.load("fr3")
    far = pin.SE3(np.eye(3), np.array([1.5, 0.0, 0.3]))
    assert descend(arm, far, (arm.lower + arm.upper) / 2) is None


@pytest.mark.parametrize("robot", ROBOTS)
def test_an_obstacle_at_the_tool_is_touched_and_one_beside_it_is_not(robot):
    arm = Arm.load(robot)
    down, alone = pin.SE3(np.diag([1.0, -1, -1]), np.array([0.5, 0.1, 0.4])), Cell(arm, [], 0.06)
    q = next(q for q in solutions(arm, down, [], np.random.default_rng(0), 100) if alone.free(q))
    # The fingers, open by 60 mm, are 12 mm thick: outer faces 42 mm from the middle, tips at z = 0.4.
    for gap, free in ((0.002, False), (0.004, True)):
        beside = block("wall", (0.02, 0.02, 0.02), (0.5, 0.1 + 0.042 + 0.01 + gap, 0.41), fixed=True)
        under = block("floor", (0.2, 0.2, 0.1), (0.5, 0.1, 0.4 - 0.05 - gap), fixed=True)
        for obstacle in (beside, under):
            cell = Cell(arm, [obstacle], 0.06)
            assert cell.free(q) is free
            assert free or obstacle.id in cell.touching(q)[1]


# -- ways ------------------------------------------------------------------------------------------------------------

BOUNDS = np.array([-2.0, -2.0]), np.array([2.0, 2.0])


def gap_in_a_wall(start, end):
    """A wall at x = 0, but for a gap at y in 1.5..1.8."""
    points = np.linspace(start, end, 200)
    return not np.any((np.abs(points[:, 0]) < 0.1) & ~((points[:, 1] > 1.5) & (points[:, 1] < 1.8)))


def test_a_way_is_found_through_a_gap_and_cut_short():
    start, goal = np.array([-1.0, -1.0]), np.array([1.0, -1.0])
    ways = [find_way(start, goal, gap_in_a_wall, BOUNDS, np.random.default_rng(4), LATER) for _ in range(2)]
    np.testing.assert_array_equal(*ways)
    short = shortened(ways[0], gap_in_a_wall, np.random.default_rng(0), LATER)
    for way in (ways[0], short):
        np.testing.assert_array_equal(way[[0, -1]], [start, goal])
        assert all(gap_in_a_wall(a, b) for a, b in pairwise(way))
    lengths = [np.linalg.norm(np.diff(way, axis=0), axis=1).sum() for way in (ways[0], short)]
    assert lengths[1] <= lengths[0]
    assert lengths[1] < 1.3 * 2 * np.hypot(1.0, 2.5)


def test_no_way_ends_with_the_nodes_or_the_time():
    def wall(start, end):
        return not np.any(np.abs(np.linspace(start, end, 200)[:, 0]) < 0.1)

    start, goal, rng = np.array([-1.0, 0.0]), np.array([1.0, 0.0]), np.random.default_rng(0)
    assert find_way(start, goal, wall, BOUNDS, rng, LATER, nodes=200) is None
    assert find_way(start, goal, wall, BOUNDS, rng, time.monotonic()) is None


@pytest.mark.parametrize("grip", [0.3, 50.0])
def test_motions_keep_to_every_limit(grip):
    arm, rng = Arm.load("fr3"), np.random.default_rng(1)
    way = np.cumsum([(arm.lower + arm.upper) / 2, *rng.uniform(-0.3, 0.3, (4, 7))], axis=0)
    limits, point = Limits(speed=0.4, acceleration=grip), np.array([0.0, 0.02, 0.05])
    motions = timed(arm, way, Cell(arm, [], 0.0), point, limits)
    np.testing.assert_allclose(motions[0].position[0], way[0])
    np.testing.assert_allclose(motions[-1].position[-1], way[-1])
    for motion in motions:
        step = motion.duration / 2000
        seconds = np.arange(0.0, motion.duration, step)
        moved = motion.at(seconds)
        assert np.all(np.abs(moved.velocity) <= limits.joint_speed * arm.velocity_limit * 1.01)
        assert np.abs(moved.acceleration).max() <= limits.joint_acceleration * 1.05
        points = np.array([arm.tool(q).act(point) for q in moved.position])
        assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() / step <= limits.speed * 1.01
        assert np.linalg.norm(np.diff(points, 2, axis=0), axis=1).max() / step**2 <= grip * 1.05
        np.testing.assert_allclose(moved.velocity[0], 0, atol=1e-9)


def test_the_half_turn_of_a_grasp_swaps_the_fingers():
    grasp = Grasp(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])), 0.05)
    np.testing.assert_allclose(grasp.turned.object_tcp.rotation[:, 1], [0, -1, 0])
    np.testing.assert_allclose(grasp.turned.approach, grasp.approach)
