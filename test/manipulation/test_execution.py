"""A transfer is played step by step on a robot of this test's own, by its own clock, and stopped when it has to be."""

import numpy as np
import pytest

from poise.errors import ErrorCode, PoiseError
from poise.manipulation.execution import RobotPort, Tolerances, TransferExecution, TransferStep, joined
from poise.manipulation.gripper import Gripper
from poise.simulation import WaypointTrajectory

TICK = 0.02
HOME, THERE, BEYOND = np.zeros(2), np.array([0.6, -0.3]), np.array([0.2, 0.5])
GRIPPER = Gripper("fingers", opened=0.0, closed=0.8, stroke=0.08, squeeze=0.005, seconds=0.5)
WIDE, CLOSED = 0.0, 0.8
GRIPPED = 0.8 - 0.8 * (0.04 - 0.005) / 0.08
ALL = ["picking", "carrying", "placing"]


def motion(start, end, duration=1.0):
    return WaypointTrajectory(np.array([0.0, duration]), np.stack([start, end]))


STEPS = (
    TransferStep("reach", None, 0.08, False),
    TransferStep("reach", motion(HOME, THERE), 0.08, False),
    TransferStep("lift", None, 0.04, True),
    TransferStep("carry", motion(THERE, BEYOND), 0.04, True),
    TransferStep("retreat", None, 0.08, False),
    TransferStep("return", motion(BEYOND, HOME), 0.08, False),
)


class FakeRobot:
    """Two joints that follow (or do not, where a test says so), and fingers that go at 2 rad/s up to what they grasp.

    Its stamps are 100 s ahead of the clock.
    """

    joint_names = ("a", "b")

    def __init__(self, feels_fingers=True):
        self.robot = RobotPort(self, GRIPPER, self._move, self._grip)
        self.now, self.feels_fingers = 5.0, feels_fingers
        self.follows = self.speaks = self.grips = True
        self.blocked_at = np.inf
        self.position, self.fingers, self._wanted = HOME.copy(), 0.4, 0.4
        self.moves, self.gripped, self._plan = [], [], (0, motion(HOME, HOME))
        for _ in range(20):
            self.run()

    def _move(self, plan, stamp):
        self.moves.append((plan, stamp))
        self._plan = stamp, plan

    def _grip(self, position):
        self.gripped.append((self.now, position))
        self._wanted = position

    def run(self):
        """Let 20 ms pass."""
        for _ in range(4):
            self.now += TICK / 4
            stamp = round((self.now + 100.0) * 1e9)
            begin, plan = self._plan
            if self.follows and stamp > begin:
                self.position = plan.at(np.array([(stamp - begin) * 1e-9])).position[0]
            step = np.clip(self._wanted - self.fingers, -0.01, 0.01) if self.grips else 0.0
            self.fingers = min(self.fingers + step, self.blocked_at)
            if self.speaks:
                names, values = list(self.joint_names), self.position.tolist()
                more = (["fingers"], [self.fingers]) if self.feels_fingers else ([], [])
                self.robot.add_joint_state(stamp, names + more[0], values + more[1], self.now)

    def play(self, steps=STEPS, **tolerances):
        return TransferExecution("can", steps, self.robot, Tolerances(**tolerances), self.now)

    def until(self, playing, condition=lambda: False, seconds=20.0):
        """Tick until it is done or the condition holds; the stages in between."""
        stages, end = [playing.stage], self.now + seconds
        while not playing.done and not condition():
            assert self.now < end
            playing.tick(self.now)
            self.run()
            if stages[-1] != playing.stage:
                stages.append(playing.stage)
        return stages


@pytest.mark.parametrize("feels", [True, False])
def test_every_step_waits_for_the_one_before(feels):
    fake = FakeRobot(feels)
    begun, playing = fake.now, fake.play()
    assert fake.until(playing) == ALL
    assert playing.error is None
    assert [position for _, position in fake.gripped] == pytest.approx([WIDE, GRIPPED, WIDE])
    assert [plan for plan, _ in fake.moves] == [step.motion for step in STEPS if step.motion is not None]
    np.testing.assert_allclose(fake.position, HOME, atol=1e-3)
    # A motion begins when the fingers have come, and they are commanded when it has ended.
    for (sent, _), (plan, stamp), wait in zip(fake.gripped, fake.moves, (0.2, 0.5, 0.25), strict=True):
        begin = stamp * 1e-9 - 100.0
        assert begin - sent > wait
        following = [at for at, _ in fake.gripped if at > sent]
        assert all(at > begin + plan.duration for at in following)
    assert fake.now - begun < 3 * (1.0 + 0.2) + 3 * 0.8


def test_what_is_grasped_stops_the_fingers_and_that_is_right_only_then():
    fake = FakeRobot()
    fake.blocked_at = GRIPPED - 0.08  # 8 mm wider than commanded
    playing = fake.play()
    fake.until(playing)
    assert playing.error is None
    fake.blocked_at = 0.3  # closing on nothing, they are to come all the way
    playing = fake.play([TransferStep("return", None, 0.0, False), *STEPS[1:2]])
    fake.until(playing)
    assert playing.error.code is ErrorCode.NOT_FOLLOWING
    assert "fingers is at 0.300 and was commanded to 0.800" in playing.error.message


def test_fingers_that_do_not_open_keep_the_arm_away():
    fake = FakeRobot()
    fake.grips = False
    playing = fake.play()
    fake.until(playing)
    assert (playing.error.code, fake.moves) == (ErrorCode.NOT_FOLLOWING, [])
    assert "gripper_trajectory" in playing.error.message


@pytest.mark.parametrize(
    ("stage", "hand"),
    [("picking", "its hand is empty"), ("carrying", "it still holds it"), ("placing", "its hand is empty")],
)
def test_cancelled_it_stops_on_its_way_and_says_what_is_in_the_hand(stage, hand):
    fake = FakeRobot()
    playing = fake.play()
    index = ALL.index(stage)
    way = STEPS[2 * index + 1].motion

    def amid():
        return len(fake.moves) == index + 1 and fake.now + 100.0 > fake.moves[-1][1] * 1e-9 + 0.4

    fake.until(playing, amid)
    playing.cancel(fake.now)
    assert (playing.done, playing.error.code) == (True, ErrorCode.CANCELLED)
    assert playing.error.message == f"the arm stopped while {stage} can; {hand}"
    places = []
    for _ in range(50):
        fake.run()
        places.append(fake.position)
    assert np.ptp(places[-25:], axis=0).max() < 1e-9
    assert np.linalg.norm(places[-1] - way.position[-1]) > 0.05  # it never came to the end
    run = way.position[-1] - way.position[0]
    along = (np.array(places) - way.position[0]) @ run / (run @ run)
    np.testing.assert_allclose(places, way.position[0] + along[:, None] * run, atol=1e-9)  # and never left its way
    before = len(fake.gripped), len(fake.moves)
    playing.tick(fake.now)
    playing.cancel(fake.now)
    assert (len(fake.gripped), len(fake.moves)) == before


def test_a_cancel_that_the_watchdog_hears_first_has_the_same_words(monkeypatch):
    fake = FakeRobot()
    playing = fake.play()
    fake.until(playing, lambda: playing.stage == "carrying")

    def stopped():
        raise PoiseError(ErrorCode.CANCELLED, "the goal was cancelled")

    monkeypatch.setattr(fake.robot.commanded, "check", stopped)
    playing.tick(fake.now)
    assert playing.error.message == "the arm stopped while carrying can; it still holds it"


def test_cancelled_between_motions_an_arm_at_rest_is_left_alone():
    fake = FakeRobot()
    playing = fake.play()
    fake.until(playing, lambda: len(fake.gripped) == 2)
    playing.cancel(fake.now)
    assert len(fake.moves) == 1
    assert playing.error.message == "the arm stopped while picking can; its fingers were closing"


def test_an_arm_that_does_not_follow_is_commanded_to_stay_where_it_is():
    fake = FakeRobot()
    playing = fake.play()
    fake.until(playing, lambda: fake.position[0] > 0.3)
    fake.follows, held_up = False, fake.position.copy()
    fake.until(playing)
    assert playing.error.code is ErrorCode.NOT_FOLLOWING
    assert "a is 0." in playing.error.message
    assert "while picking can" in playing.error.message
    np.testing.assert_allclose(fake.moves[-1][0].position, [held_up, held_up])


@pytest.mark.parametrize(("failures", "stops"), [(1, 1), (2, 0)])
def test_a_stop_that_fails_is_replaced_by_holding_the_pose_and_the_tick_never_raises(failures, stops):
    fake = FakeRobot()
    playing = fake.play()
    fake.until(playing, lambda: fake.position[0] > 0.3)
    move, left = fake.robot.move, [OSError("the publisher is gone")] * failures

    def failing(plan, stamp):
        if left:
            raise left.pop()
        move(plan, stamp)

    fake.robot.move = failing
    before = len(fake.moves)
    playing.cancel(fake.now)
    assert playing.done
    assert playing.error.code is ErrorCode.CANCELLED
    assert len(fake.moves) == before + stops
    assert ("could not be sent" in playing.error.message) == (stops == 0)
    if stops:
        assert np.ptp(fake.moves[-1][0].position, axis=0).max() == 0


def test_an_arm_that_stops_short_of_the_end_has_its_slack_and_no_more():
    fake = FakeRobot()
    playing = fake.play(slack=0.5)
    fake.until(playing, lambda: np.abs(fake.position - THERE).max() < 0.01)
    fake.follows, since = False, fake.now
    fake.until(playing)
    assert playing.error.code is ErrorCode.NOT_FOLLOWING
    assert "off the end of reach" in playing.error.message
    assert 0.4 < fake.now - since < 1.0


def test_joint_states_that_stop_coming_stop_the_arm_along_its_way():
    fake = FakeRobot()
    playing = fake.play()
    fake.until(playing, lambda: len(fake.moves) == 2)
    fake.speaks = False
    fake.until(playing)
    assert playing.error.code is ErrorCode.SENSOR_STALE
    assert "it still holds it" in playing.error.message
    assert len(fake.moves) == 3
    assert not fake.moves[-1][0].velocity[-1].any()


def test_a_process_that_was_held_up_does_not_blame_the_robot():
    fake = FakeRobot()
    playing = fake.play()
    fake.until(playing, lambda: len(fake.moves) == 1)
    fake.now += 0.8  # messages wait
    playing.tick(fake.now)
    assert not playing.done


def test_an_arm_that_was_moved_meanwhile_is_not_commanded():
    fake = FakeRobot()
    fake.position = HOME + 0.1
    fake.follows = False
    fake.run()
    playing = fake.play()
    fake.until(playing)
    assert (playing.error.code, fake.moves, fake.gripped) == (ErrorCode.BUSY, [], [])


def test_where_it_rests_is_known_only_when_it_does():
    fake = FakeRobot()
    np.testing.assert_array_equal(fake.robot.rests_at(fake.now, fake.now), HOME)
    fake.robot.move(motion(HOME, THERE, 5.0), 0)
    fake._plan = round((fake.now + 99.0) * 1e9), motion(HOME, THERE, 5.0)
    for _ in range(10):
        fake.run()
    assert fake.robot.rests_at(fake.now, fake.now) is None
    with pytest.raises(Exception, match="the arm is moving") as error:
        fake.robot.rests_at(fake.now, fake.now - 10.0)
    assert error.value.code is ErrorCode.BUSY


def test_motions_joined_are_the_motions_one_after_another():
    parts = [motion(HOME, THERE, 0.5), motion(THERE, BEYOND, 0.7)]
    both = joined(parts)
    at = np.linspace(0.0, 0.5, 20)
    np.testing.assert_allclose(both.at(at).position, parts[0].at(at).position, atol=1e-12)
    np.testing.assert_allclose(both.at(0.5 + at).velocity, parts[1].at(at).velocity, atol=1e-12)
    assert both.duration == pytest.approx(1.2)


def test_the_opening_is_in_proportion_to_the_joint_and_a_grip_goes_beyond():
    assert [GRIPPER.position(opening, False) for opening in (0.08, 0.0, 0.02)] == pytest.approx([WIDE, CLOSED, 0.6])
    assert GRIPPER.position(0.04, True) == pytest.approx(GRIPPED)
    assert GRIPPER.position(0.001, True) == CLOSED


def test_fingers_that_do_not_close_hold_nothing():
    fake = FakeRobot()
    playing = fake.play()
    fake.until(playing, lambda: len(fake.moves) == 1)
    fake.grips = False
    fake.until(playing)
    assert (playing.error.code, len(fake.moves)) == (ErrorCode.NOT_FOLLOWING, 1)
    assert "its fingers were closing" in playing.error.message


@pytest.mark.parametrize("moment", ["in transport", "before"])
def test_what_drops_from_the_hand_stops_the_arm(moment):
    fake = FakeRobot()
    fake.blocked_at = GRIPPED - 0.05  # 5 mm wider than commanded
    playing = fake.play(STEPS[:4])
    fake.until(playing, lambda: len(fake.moves) == 2 and fake.now + 100.0 > fake.moves[1][1] * 1e-9 + 0.3)
    if moment == "before":  # it drops after weighing, say, before it is placed
        fake.until(playing)
        fake.blocked_at = np.inf
        for _ in range(20):
            fake.run()
        on = [TransferStep("lower", motion(BEYOND, HOME), 0.04, True)]
        playing = TransferExecution("can", on, fake.robot, Tolerances(), fake.now, playing.held)
    fake.blocked_at = np.inf
    moved = len(fake.moves)
    fake.until(playing)
    assert (playing.error.code, playing.dropped) == (ErrorCode.NOT_HELD, True)
    assert playing.error.message.endswith("its hand is empty")
    assert len(fake.moves) == moved + (moment == "in transport")  # its stop; an arm at rest gets none
    for _ in range(100):
        fake.run()
    assert fake.robot.joints.at_rest()


@pytest.mark.parametrize("believed", [0.025, 0.045, 0.05, 0.08])
def test_what_is_held_is_not_lost_because_it_is_not_as_wide_as_believed(believed):
    """A scanned shape, or an L that is wider beside the fingers: where they gripped it counts."""
    fake = FakeRobot()
    fake.blocked_at = GRIPPED - 0.05
    playing = fake.play(STEPS[:4])
    fake.until(playing)
    on = [TransferStep("lower", motion(BEYOND, HOME), believed, True)]
    for held in (playing.held, None):
        fake.position, fake._plan = BEYOND.copy(), (0, motion(BEYOND, BEYOND))
        for _ in range(60):
            fake.run()
        playing = TransferExecution("can", on, fake.robot, Tolerances(), fake.now, held)
        fake.until(playing)
        assert (playing.error, playing.dropped) == (None, False)


def test_fingers_that_do_not_close_before_the_arm_moves_may_hold_something():
    fake = FakeRobot()
    fake.blocked_at = GRIPPED
    playing = fake.play([TransferStep("reach", None, 0.0, False), *STEPS[:2]])
    fake.until(playing)
    assert (playing.error.code, len(fake.moves)) == (ErrorCode.NOT_FOLLOWING, 0)
    assert "is something between the fingers" in playing.error.message


def test_a_clock_that_is_set_back_ends_it():
    fake = FakeRobot()
    playing = fake.play()
    fake.until(playing, lambda: len(fake.moves) == 1)
    stamp = round((fake.now - 400.0) * 1e9)
    fake.robot.add_joint_state(stamp, ["a", "b", "fingers"], [*fake.position, fake.fingers], fake.now)
    playing.tick(fake.now)
    assert (playing.done, playing.error.code) == (True, ErrorCode.SENSOR_STALE)
