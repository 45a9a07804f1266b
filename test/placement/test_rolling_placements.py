"""Placements that may roll are not proposed; chocked ones are."""

import numpy as np
import pytest

from poise.assembly import Analysis, Assembly, Box, Cylinder, RigidObject, Sphere
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


def test_a_can_lies_nowhere_under_a_low_shelf_but_stands_where_there_is_room() -> None:
    planner = PLACEMENT_PLANNERS.find("poise")
    low = (("too high", lambda item: item.pose.translation[2] < 0.07),)
    with pytest.raises(NoAnswerError, match="may roll") as caught:
        planner.plan(Analysis.of(Assembly((FLOOR, SHELF))), CAN, Options(attempts=60, looks=low), 0, lambda *_: True)
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    found = planner.plan(Analysis.of(Assembly((FLOOR,))), CAN, Options(), 0, lambda *_: True)
    assert abs(found.pose.rotation[2, 2]) == pytest.approx(1.0)
