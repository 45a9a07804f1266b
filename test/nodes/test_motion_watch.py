"""What stops a motion without regard to what its program computes, by a clock of the test."""

import numpy as np
import pytest

from poise.errors import ErrorCode
from poise.nodes.motion_watch import MotionWatch, WatchLimits

pytest.importorskip("rclpy")
BEGIN = 1_000_000_000_000
"""ns of the motion; the clock of the stamps is 900 s ahead."""
LIMITS = WatchLimits(silence=0.3, unattended=0.4, force=10.0, needs_wrench=True)
STEP = 0.004


class Played:
    """A watch over a motion of 1 s by one joint at 0.5 rad/s, looked at every 4 ms."""

    def __init__(self, limits=LIMITS):
        self.now, self.watch = 100.0, MotionWatch(("a",), limits, 100.0)
        self.speed, self.force = 0.5, 1.0
        self.speaks = self.weighs = self.beats = True
        self.run(0.1, moving=False)
        self.watch.arm(np.linspace(0.0, 1.0, 51).tolist(), [0.5], BEGIN, self.now)

    def run(self, seconds, moving=True):
        """Let time pass; the first problem and when it was seen, or None."""
        end = self.now + seconds
        while self.now < end:
            self.now += STEP
            stamp = round((self.now + 900.0) * 1e9)
            if self.speaks:
                place = self.speed * (self.now - 100.1) if moving else 0.0
                self.watch.joint_state(stamp, {"a": place, "b": 0.0}, self.now)
            if self.weighs:
                self.watch.wrench((0.0, 0.0, self.force), self.now)
            if self.beats:
                self.watch.beat(self.now)
            if (problem := self.watch.problem(self.now)) is not None:
                return problem, self.now
        return None


def test_a_motion_as_planned_goes_on():
    assert Played().run(2.0) is None


@pytest.mark.parametrize(
    ("change", "code", "word", "after"),
    [
        ({"speaks": False}, ErrorCode.SENSOR_STALE, "joint state", 0.3),
        ({"weighs": False}, ErrorCode.SENSOR_STALE, "wrench", 0.3),
        ({"beats": False}, ErrorCode.INTERNAL, "did not supervise", 0.4),
        ({"force": 12.0}, ErrorCode.IN_CONTACT, "11 N", 0.0),
        ({"speed": 5.0}, ErrorCode.NOT_FOLLOWING, "a moves at", 0.0),
    ],
)
def test_what_is_wrong_is_seen_within_two_looks(change, code, word, after):
    played = Played()
    assert played.run(0.3) is None
    for name, value in change.items():
        setattr(played, name, value)
    since = played.now
    problem, seen = played.run(1.0)
    assert problem.code is code
    assert word in problem.message
    assert after <= seen - since <= after + 2.5 * STEP
    played.watch.disarm()
    assert played.run(0.5) is None


def test_the_speed_of_the_motion_before_does_not_count():
    played = Played()
    played.watch.arm([0.0, 1.0], [5.0], BEGIN, played.now)
    played.speed = 4.0
    assert played.run(0.3) is None
    begin = round((played.now + 900.0) * 1e9)
    played.watch.arm([0.0, 1.0], [0.5], begin, played.now)
    assert played.watch.problem(played.now) is None
    problem, _ = played.run(1.0)
    assert problem.code is ErrorCode.NOT_FOLLOWING  # but its own does


def test_a_jump_right_after_the_begin_is_seen_at_once_and_noise_is_not():
    played = Played()
    played.speed = 0.0
    noise = np.random.default_rng(0).uniform(-0.003, 0.003, 100)
    for number, place in enumerate(noise[:6]):
        played.watch.joint_state(BEGIN + number * 4_000_000, {"a": place}, played.now)
        assert played.watch.problem(played.now) is None
    played.watch.joint_state(BEGIN + 24_000_000, {"a": 0.2}, played.now)
    assert played.watch.problem(played.now).code is ErrorCode.NOT_FOLLOWING


def test_the_stop_that_comes_next_is_chosen():
    played = Played()
    played.run(0.3)
    chosen = played.watch.stop(played.now)
    at = played.now + 900.0 + LIMITS.lead - BEGIN * 1e-9
    assert -1e-6 <= chosen.number * 0.02 - at <= 0.02 + 1e-6
    assert chosen.stamp == BEGIN + round(chosen.number * 0.02 * 1e9)
    assert played.watch.stop(played.now + 5.0).number == 50  # at rest at the end
    assert played.watch.stop(played.now - 5.0).number == 0


def test_a_watch_that_was_held_up_reads_what_waits_before_it_stops_an_arm():
    played = Played()
    played.run(0.2)
    played.now += 0.6
    assert played.run(0.2) is None


def test_a_limit_of_force_needs_wrenches():
    limits = WatchLimits(silence=0.3, force=10.0)
    watch = MotionWatch(("a",), limits, 0.0)
    watch.joint_state(1, {"a": 0.0}, 0.0)
    assert not watch.ready
    played = Played(limits)
    assert played.run(0.3) is None
    played.weighs = False
    problem, _ = played.run(1.0)
    assert problem.code is ErrorCode.SENSOR_STALE
    assert "wrench" in problem.message


def test_messages_of_another_robot_are_no_sign_of_life():
    watch = MotionWatch(("a",), WatchLimits(), 0.0)
    watch.joint_state(1, {"b": 0.0}, 0.0)
    assert not watch.ready
