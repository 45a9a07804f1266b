"""A pick is verified by what was lifted; what is not held, or is something else, is put down again."""

import itertools

import numpy as np
import pytest
from test_execution import HOME, THERE, FakeRobot, motion

from poise.assembly import Analysis, Assembly, Box, Cylinder, RigidObject
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose
from poise.manipulation import (
    Arm,
    ForceWatch,
    Pick,
    PickExecution,
    PickSteps,
    Reach,
    Tolerances,
    heavier,
    lifted_mass,
    pick_steps,
    plan_pick,
    without_held,
)
from poise.manipulation.execution import TransferStep
from poise.robot import RobotModel
from poise.simulation import home
from poise.world import assumed_weight

G = 9.80665
ZERO = np.array([1.0, -2.0, 3.0])
DOWN = np.array([0.0, 0.0, -G])
UP = np.array([0.5, -0.2])
STEPS = PickSteps(
    (TransferStep("reach", None, 0.0, False), TransferStep("reach", motion(HOME, THERE), 0.0, False)),
    (
        TransferStep("approach", None, 0.08, False),
        TransferStep("lift", None, 0.04, True),
        TransferStep("lift", motion(THERE, UP), 0.04, True),
    ),
    (TransferStep("hold", motion(UP, HOME), 0.04, True),),
    (TransferStep("lower", motion(UP, THERE), 0.04, True), TransferStep("retreat", None, 0.08, False)),
)
FLOOR = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose.from_vector([0, 0, -0.05, 0, 0, 0, 1]), fixed=True)
CAN = RigidObject("can", Cylinder(0.03, 0.1), Pose.from_vector([0.4, -0.2, 0.05, 0, 0, 0, 1]), mass=0.3)


class Picking:
    """A pick on the fake robot, whose sensor feels `mass` once the fingers have closed."""

    def __init__(self, mass, known=True, aside=0.0, item=CAN, verify=True, hold=20.0):
        self.fake, self.mass, self.aside, self.speaks = FakeRobot(), mass, aside, True
        self.events, self.rng = [], np.random.default_rng(0)
        self.forces = ForceWatch() if verify else None
        pick = Pick(None, None, hold, item.mass, (), (), (), (), 0.0)
        self.running = PickExecution(
            item, known, pick, STEPS, self.fake.robot, Tolerances(), self.forces, DOWN, G,
            lambda: self.events.append("grasped"), lambda: self.events.append("released"), self.fake.now,
        )  # fmt: skip

    def until(self, condition=lambda: False):
        end = self.fake.now + 30.0
        while not self.running.done and not condition():
            assert self.fake.now < end
            load = np.array([self.aside, 0.0, -self.mass * G]) if self.running.holding else np.zeros(3)
            if self.speaks and self.forces is not None:
                self.forces.add(load + ZERO + self.rng.normal(scale=0.02, size=3), self.fake.now)
            self.running.tick(self.fake.now)
            self.fake.run()
        return self.running


def test_what_was_lifted_is_weighed_and_brought_back():
    picking = Picking(0.302)
    running = picking.until()
    assert running.error is None
    assert running.holding
    assert picking.events == ["grasped"]
    assert abs(running.mass.mass - 0.302) < 3 * running.mass.std < 0.03
    np.testing.assert_allclose(picking.fake.position, HOME, atol=1e-3)


@pytest.mark.parametrize(
    ("mass", "aside", "word"), [(0.0, 0.0, "nothing was lifted"), (0.2, 0.0, "believed"), (0.3, 1.5, "touches")]
)
def test_what_is_not_held_as_believed_is_put_down_and_may_be_tried_again(mass, aside, word):
    picking = Picking(mass, aside=aside)
    running = picking.until()
    assert (running.error.code, running.retry, running.holding) == (ErrorCode.NOT_HELD, True, False)
    assert word in running.error.message
    assert picking.events == ["grasped", "released"]
    np.testing.assert_allclose(picking.fake.position, THERE, atol=1e-3)


def test_a_mass_that_was_only_assumed_may_be_another_one():
    running = Picking(0.5, known=False, item=assumed_weight(CAN)).until()
    assert running.error is None
    assert running.mass.mass == pytest.approx(0.5, abs=0.02)


def test_more_than_the_grip_holds_is_put_down_and_not_tried_again():
    running = Picking(0.9, known=False, hold=12.0).until()
    assert (running.error.code, running.retry, running.holding) == (ErrorCode.TOO_HEAVY, False, False)


def test_a_sensor_that_falls_silent_after_the_lift_leaves_nothing_in_the_hand_unverified():
    picking = Picking(0.3)
    picking.until(lambda: picking.running.holding)
    picking.speaks = False
    running = picking.until()
    assert (running.error.code, running.retry, running.holding) == (ErrorCode.SENSOR_STALE, False, False)
    assert picking.events == ["grasped", "released"]


@pytest.mark.parametrize("stage", ["picking", "verifying", "returning"])
def test_cancelled_it_says_what_the_hand_holds(stage):
    picking = Picking(0.3)
    picking.until(lambda: picking.running.holding and picking.running.stage == stage)
    picking.running.cancel(picking.fake.now)
    running = picking.until()
    assert running.error.code == ErrorCode.CANCELLED
    assert running.holding
    assert "it still holds it" in running.error.message


def test_without_verification_the_fingers_are_trusted():
    running = Picking(0.0, verify=False).until()
    assert (running.error, running.mass, running.holding) == (None, None, True)


def test_the_zero_of_the_sensor_and_the_hand_cancel_and_an_unknown_attitude_widens_nothing():
    rows = np.full(3, 0.02)
    before, after = np.array([3.0, -4.0, 20.0]), np.array([3.0, -4.0, 20.0 - 0.5 * G])
    for down in (DOWN, None):
        assert lifted_mass((before, rows), (after, rows), down, G).mass == pytest.approx(0.5)
    upwards = lifted_mass((after, rows), (before, rows), DOWN, G)
    assert upwards.mass == pytest.approx(-0.5)  # a push from below is no load


def test_forces_after_the_measurement_are_not_kept():
    forces = ForceWatch()
    forces.begin(0.0)
    for step in range(400):
        forces.add((0.0, 0.0, 1.0), 0.1 * step)
    assert forces.average(40.0) is not None
    assert len(forces._rows) < 40


def test_what_carries_others_or_is_fixed_is_not_picked_up():
    under = RigidObject("box", Box((0.1, 0.1, 0.1)), Pose.from_vector([0.4, 0, 0.05, 0, 0, 0, 1]), mass=1.0)
    lid = RigidObject("lid", Box((0.1, 0.1, 0.02)), Pose.from_vector([0.4, 0, 0.11, 0, 0, 0, 1]), mass=0.2)
    analysis = Analysis.of(Assembly((FLOOR, under, lid)))
    with pytest.raises(NoAnswerError) as caught:
        without_held(analysis, "box")
    assert caught.value.code == ErrorCode.UNSTABLE
    assert "lid would fall" in caught.value.message
    assert [item.id for item in without_held(analysis, "lid").assembly.objects] == ["floor", "box"]
    with pytest.raises(InputError) as refused:
        without_held(analysis, "floor")
    assert refused.value.code == ErrorCode.BAD_INPUT


def test_a_pick_is_planned_with_the_way_back_and_the_way_down_and_another_grasp_is_another_one():
    arm, start = Arm.load("fr3"), home(RobotModel.from_file("fr3"))
    heavy = heavier(assumed_weight(CAN))
    assert heavy.mass == pytest.approx(1.7 * 1000 * CAN.shape.volume)
    reach = Reach(arm, Analysis.of(Assembly((FLOOR,))), heavy, start=start, seed=1)
    pick = plan_pick(reach, seed=1)
    steps = pick_steps(pick, heavy, arm, 0.5)
    names = [[step.name for step in part] for part in (steps.reach, steps.lift, steps.back, steps.undo)]
    assert names == [
        ["reach", "reach"],
        ["approach", "approach", "lift", "lift"],
        ["hold"],
        ["lower", "retreat", "retreat"],
    ]
    moves = [step for part in (steps.reach, steps.lift, steps.back) for step in part if step.motion is not None]
    for before, after in itertools.pairwise(moves):
        np.testing.assert_allclose(before.motion.position[-1], after.motion.position[0], atol=1e-9)
    np.testing.assert_allclose(moves[-1].motion.position[-1], start, atol=1e-9)
    np.testing.assert_allclose(steps.undo[0].motion.position[0], moves[2].motion.position[-1], atol=1e-9)
    turns = [arm.tool(step.motion.position[k]).rotation for step in moves[1:3] for k in (0, -1)]
    for turn in turns:  # the sensor is weighed with in one attitude
        np.testing.assert_allclose(turn, turns[0], atol=1e-5)
    other = plan_pick(reach, seed=1, tried=(pick.grasp,))
    apart = np.linalg.norm(pick.grasp.object_tcp.translation - other.grasp.object_tcp.translation)
    assert apart > 0.01 or np.abs(pick.grasp.object_tcp.rotation - other.grasp.object_tcp.rotation).max() > 0.3
