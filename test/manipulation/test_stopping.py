"""Stops of a transfer keep the limits of the joints and of the grip, by finite differences; else they say so."""

import numpy as np
import pytest

from poise.assembly import Analysis, Assembly, Box, RigidObject
from poise.errors import NoAnswerError
from poise.excitation.execution import ReadyStops, joint_judge
from poise.geometry import Pose
from poise.manipulation import Arm, Reach, TransferStep, with_stops
from poise.simulation import WaypointTrajectory

HELD = np.array([0.02, 0.0, 0.05])


@pytest.fixture(scope="module")
def arm() -> Arm:
    return Arm.load("fr3")


@pytest.fixture(scope="module")
def carry(arm) -> WaypointTrajectory:
    begin = (arm.lower + arm.upper) / 2
    end = begin + np.array([0.6, 0.3, 0.0, -0.3, 0.2, 0.4, 0.0])
    return WaypointTrajectory(np.array([0.0, 1.2]), np.stack([begin, end]))


def felt(arm, stop):
    """m/s2 of the held point, at the middle of steps of 4 ms."""
    times = np.arange(0.0, stop.duration, 0.004)
    places = np.array([arm.tool(q).act(HELD) for q in stop.at(times).position])
    return np.linalg.norm(np.diff(places, 2, axis=0), axis=1) / 0.004**2


def test_every_stop_keeps_joints_and_grip_within_their_limits(arm, carry):
    hold = 0.8 * felt(arm, carry).max()  # less than the motion itself needs: it was planned for more
    hold = max(hold, 4.0)
    steps = (TransferStep("reach", carry, 0.08, False), TransferStep("carry", carry, 0.04, True))
    free, held = (step.stops for step in with_stops(steps, arm, HELD, hold))
    for stop in held.stops[::4]:
        hardest = felt(arm, stop.motion).max()
        assert stop.excess or hardest <= 1.05 * hold
        assert not stop.excess or "slips above" in stop.excess or "acceleration" in stop.excess
    for stop in free.stops[::4]:
        assert not stop.excess
        motion = stop.motion.at(np.linspace(0.0, stop.motion.duration, 200))
        assert np.abs(motion.acceleration).max() <= 12.5 + 1e-9
        assert (np.abs(motion.velocity) <= arm.velocity_limit).all()
        np.testing.assert_allclose(motion.velocity[-1], 0.0, atol=1e-9)
    assert sum(stop.motion.duration for stop in held.stops) > sum(stop.motion.duration for stop in free.stops)


def test_where_no_stop_keeps_the_limits_the_fastest_is_ready_and_names_them(arm, carry):
    (step,) = with_stops([TransferStep("carry", carry, 0.04, True)], arm, HELD, 0.01)
    middle = step.stops.after(0.6)
    assert "slips above 0.01" in middle.excess
    assert middle.motion.duration == pytest.approx(0.15)
    slow = ReadyStops.judged(carry, joint_judge(arm.joint_names, 1e-3 * arm.velocity_limit))
    assert "rad/s of fr3_joint" in slow.after(0.6).excess


@pytest.mark.parametrize(
    ("size", "mass", "word"), [((0.2, 0.2, 0.1), 0.3, "too wide"), ((0.05, 0.05, 0.1), 60.0, "too heavy")]
)
def test_why_no_grasp_holds_an_object_is_named(size, mass, word):
    table = RigidObject(
        "table", Box(np.array((2.0, 2.0, 0.02))), Pose.from_vector([0, 0, -0.01, 0, 0, 0, 1]), fixed=True
    )
    item = RigidObject("box", Box(np.array(size)), Pose.from_vector([0.45, 0, size[2] / 2, 0, 0, 0, 1]), mass=mass)
    reach = Reach(Arm.load("fr3"), Analysis.of(Assembly((table,), friction=0.5)), item)
    with pytest.raises(NoAnswerError, match=word) as error:
        reach.require_pick()
    assert error.value.data["cause"] == word.replace(" ", "_")
