"""Placements that may roll are not proposed; chocked ones are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poise.assembly import Analysis, Assembly, Box, Cylinder, RigidObject, Sphere, acceleration_limits
from poise.assembly.statics import rolling
from poise.errors import ErrorCode, NoAnswerError
from poise.geometry import Pose, rotation_about
from poise.placement import PLACEMENT_PLANNERS, Options, Validator

R = 0.03
LYING = rotation_about(np.array([1.0, 0, 0]), np.pi / 2)
FLOOR = RigidObject("floor", Box((0.5, 0.5, 0.02)), Pose(np.eye(3), np.array([0, 0, -0.01])), fixed=True)
SHELF = RigidObject("shelf", Box((0.5, 0.5, 0.02)), Pose(np.eye(3), np.array([0, 0, 0.08])), fixed=True)
CAN = RigidObject("can", Cylinder(R, 0.1), Pose.identity(), mass=0.4)
BALL = RigidObject("ball", Sphere(R), Pose.identity(), mass=0.4)


def block(name: str, x: float, height: float) -> RigidObject:
    return RigidObject(name, Box((0.02, 0.3, height)), Pose(np.eye(3), np.array([x, 0, height / 2])), fixed=True)


def accepted(item: RigidObject, *others: RigidObject) -> tuple[bool, dict[str, int]]:
    validator = Validator(Analysis.of(Assembly((FLOOR, *others))), item, settling=False)
    pose = Pose(LYING, np.array([0, 0, R]))
    return validator.accept(pose) is not None, dict(validator.rejected)


@pytest.mark.parametrize("item", [CAN, BALL], ids=["can", "ball"])
def test_on_a_bare_floor_or_beside_one_lip_it_may_roll(item: RigidObject) -> None:
    for others in ((), (block("lip", R + 0.01, 0.05),)):
        assert accepted(item, *others) == (False, {"may roll: no chock or lip holds it": 1})


def test_a_can_between_two_lips_or_chocks_is_accepted() -> None:
    assert accepted(CAN, block("left", -R - 0.01, 0.05), block("right", R + 0.01, 0.05))[0]
    reach = np.sqrt(R**2 - (R - 0.01) ** 2) + 0.01
    assert accepted(CAN, block("left", -reach, 0.01), block("right", reach, 0.01))[0]


DOWNHILL, WEIGHT = 1.5, 9.69
LIP = block("lip", 0.1, 0.03)


def on_a_slope(item: RigidObject, *others: RigidObject, rolling: float = 0.002, aside: float = 0.0) -> Assembly:
    """An object on a floor that falls towards a lip along x, and by `aside` m/s2 along y."""
    gravity = np.array([DOWNHILL, aside, -WEIGHT])
    return Assembly((FLOOR, LIP, *others, item), gravity, 0.5, rolling=rolling)


def against_the_lip(item: RigidObject, off: float = 0.0, y: float = 0.0) -> RigidObject:
    """Lying in the corner of floor and lip, m into both of them."""
    return replace(item, pose=Pose(LYING, np.array([0.09 - R + off, y, R - off])))


def rolls(assembly: Assembly) -> list[tuple[str, ...]]:
    return [found.objects for found in rolling(Analysis.of(assembly))]


@pytest.mark.parametrize("off", [0.0, 1e-4, -1e-4])
def test_a_lip_below_holds_a_can_but_along_it_a_ball_rolls(off: float) -> None:
    """The ball's contacts with the face and with the edge of the lip, at its height, are one point."""
    assert rolls(on_a_slope(against_the_lip(CAN, off))) == []
    assert rolls(on_a_slope(against_the_lip(BALL, off))) == [("ball",)]


def test_a_stop_below_at_its_end_holds_the_ball_in_the_corner() -> None:
    stop = RigidObject("stop", Box((0.2, 0.02, 0.04)), Pose(np.eye(3), np.array([0.0, R + 0.01, 0.02])), fixed=True)
    assert rolls(on_a_slope(against_the_lip(BALL), stop, aside=1.0)) == []


def test_what_lies_against_a_lip_leaves_it_when_the_base_accelerates_more_than_the_slope() -> None:
    """Closed form: the lip carries nothing from an acceleration of the slope's; rolling resistance may hold more."""
    limits = acceleration_limits(on_a_slope(against_the_lip(CAN)), np.array([[1.0, 0, 0]]), turning=False)
    assert DOWNHILL * 0.999 <= limits.limits[0] <= DOWNHILL + 0.002 * WEIGHT * 1.001


def test_on_a_narrow_lip_a_can_rolls_off_although_a_corner_of_the_lip_is_near() -> None:
    """The corner is 0.05 mm under the round side, in the plane of the face on which the side lies."""
    turn = Pose.from_vector([0.0976037, -0.1844123, 0.0599639, 0.360104, -0.6085434, 0.3298105, 0.6254799])
    narrow = RigidObject("narrow", Box((0.02, 0.4, 0.03)), Pose(np.eye(3), np.array([0.1, 0, 0.015])), fixed=True)
    there = replace(CAN, pose=Pose(turn.rotation, turn.translation + np.array([0, 0, 0.06 - turn.translation[2]])))
    assert rolls(Assembly((FLOOR, narrow, there))) == [("can",)]


def test_mujoco_holds_the_can_against_the_lip_and_lets_the_ball_roll_along_it(tmp_path: Path) -> None:
    travel = pytest.importorskip("benchmarks.rolling").travel
    can = on_a_slope(against_the_lip(CAN), rolling=0.02)
    limit = acceleration_limits(can, np.array([[1.0, 0, 0]]), turning=False).limits[0]
    most = DOWNHILL + 0.02 * WEIGHT
    for way, moves in (((0.9 * limit, 0, 0), False), ((1.1 * most, 0, 0), True), ((0, 0.5, 0), False)):
        gone = travel(can, np.array(way), tmp_path / "can.xml", 0.5, capsules=True)
        assert (gone > 1e-3, gone < 3e-4) == (moves, not moves)
    ball = on_a_slope(against_the_lip(BALL), rolling=0.002)
    assert travel(ball, np.array([0, 0.5, 0]), tmp_path / "ball.xml", 0.5) > 1e-2


def test_a_can_lies_nowhere_under_a_low_shelf_but_stands_where_there_is_room() -> None:
    planner = PLACEMENT_PLANNERS.find("poise")
    low = (("too high", lambda item: item.pose.translation[2] < 0.07),)
    with pytest.raises(NoAnswerError, match="may roll") as caught:
        planner.plan(Analysis.of(Assembly((FLOOR, SHELF))), CAN, Options(attempts=60, looks=low), 0, lambda *_: True)
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    found = planner.plan(Analysis.of(Assembly((FLOOR,))), CAN, Options(), 0, lambda *_: True)
    assert abs(found.pose.rotation[2, 2]) == pytest.approx(1.0)
