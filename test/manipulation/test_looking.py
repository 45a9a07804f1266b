"""A sweep of the camera is planned over a region: it covers it, is free, ends where it began, or it is said why not."""

from dataclasses import replace

import numpy as np
import pytest

from poise.assembly import Box, RigidObject
from poise.errors import ErrorCode, PoiseError
from poise.geometry import Pose, rotation_about
from poise.manipulation import Arm, plan_look
from poise.manipulation.cell import Cell
from poise.robot import RobotModel
from poise.scanning import Camera, ViewRegion, chosen_places
from poise.simulation import home

UP = np.array([0.0, 0.0, 1.0])
CAMERA = Camera(320, 240, 308.0, 308.0, 159.5, 119.5)
EYE = "ft_sensor", Pose.from_vector([0.075, 0, -0.0175, 0, 0, 0.5**0.5, 0.5**0.5])
TABLE = RigidObject("table", Box((0.5, 0.5, 0.02)), Pose(np.eye(3), np.array([0.5, 0.0, -0.01])), fixed=True)
START = home(RobotModel.from_file("fr3", "ft_sensor"))


@pytest.fixture(scope="module")
def arm() -> Arm:
    return Arm.load("fr3")


def region(x: float = 0.5, size: float = 0.25) -> ViewRegion:
    return ViewRegion(Pose(np.eye(3), np.array([x, 0.0, 0.05])), np.array([size, size, 0.1]))


def test_a_sweep_covers_its_region_and_touches_nothing(arm: Arm) -> None:
    plan = plan_look(arm, EYE, CAMERA, region(), [TABLE], START)
    assert plan.seen > 0.8
    assert 5 <= len(plan.eyes) <= 14
    directions = plan.eyes - region().pose.translation
    azimuths = np.sort(np.degrees(np.arctan2(directions[:, 1], directions[:, 0])))
    assert np.diff(azimuths, append=azimuths[0] + 360).max() < 160  # from several sides
    motion = plan.motion
    np.testing.assert_allclose(motion.position[[0, -1]], [START, START], atol=1e-9)
    around = (TABLE, RigidObject("region", Box((0.25, 0.25, 0.1)), region().pose, fixed=True))
    cell = Cell(arm, around, 0.0)
    assert all(cell.free(q) for q in motion.at(np.arange(0.0, motion.duration, 0.1)).position)


def test_what_hides_the_region_costs_views(arm: Arm) -> None:
    wall = RigidObject("wall", Box((0.02, 0.5, 0.3)), Pose(np.eye(3), np.array([0.33, 0.0, 0.15])), fixed=True)
    bare, hidden = (plan_look(arm, EYE, CAMERA, region(), around, START).seen for around in ([TABLE], [TABLE, wall]))
    assert hidden < bare


@pytest.mark.parametrize(
    ("x", "eye", "code"),
    [
        (3.0, EYE, ErrorCode.UNREACHABLE),
        (0.5, ("base_link", EYE[1]), ErrorCode.UNSUPPORTED),
        (0.5, ("nowhere", EYE[1]), ErrorCode.FRAME_UNKNOWN),
        (0.3, EYE, ErrorCode.INTERPENETRATION),
    ],
)
def test_what_cannot_be_seen_is_refused(arm: Arm, x: float, eye: tuple[str, Pose], code: ErrorCode) -> None:
    tall = ViewRegion(Pose(np.eye(3), np.array([x, 0.0, 0.4])), np.array([0.4, 0.4, 0.8]))
    wanted = tall if code is ErrorCode.INTERPENETRATION else region(x)
    with pytest.raises(PoiseError) as caught:
        plan_look(arm, eye, CAMERA, wanted, [TABLE], START)
    assert caught.value.code == code


def test_an_arm_on_a_base_that_has_driven_stands_where_tf_has_its_foot() -> None:
    arm = Arm.load("ridgeback_ur10", tcp_frame="ft_sensor")
    name, placement = arm.foot
    assert name != arm.model.frames[1].name
    driven = Pose(rotation_about(UP, 0.5), np.array([2.0, 1.0, 0.0]))
    foot = driven @ Pose(np.array(placement.rotation), np.array(placement.translation))
    q = (arm.lower + arm.upper) / 2
    moved, still = arm.standing_on(foot).tool(q), replace(arm, base=arm.base.Identity()).tool(q)
    np.testing.assert_allclose(driven.apply(np.array(still.translation)), moved.translation, atol=1e-9)


def test_places_outside_of_the_region_do_not_count() -> None:
    places = np.array([[0.5, 0.1, 0.05], [0.52, 0.0, 0.03], [0.9, 0.0, 0.03]])
    assert chosen_places(places, region(), None, True) == [(0.52, 0.0, 0.03), (0.5, 0.1, 0.05)]
    assert chosen_places(places, region(), (0.5, 0.2, 0.0), False) == [(0.5, 0.1, 0.05)]
    assert chosen_places(places, None, None, False) == [None]
    with pytest.raises(PoiseError, match="nothing stands in the region"):
        chosen_places(places[2:], region(), None, True)
