"""An arm is never without a stop: failing publishers, a watchdog that is late, and one that refuses."""

import numpy as np
import pytest

from poise.errors import ErrorCode, PoiseError
from poise.excitation.execution import CommandedArm, JointWatch, ReadyStops, SentStop
from poise.simulation import WaypointTrajectory

STOPS = ReadyStops.judged(WaypointTrajectory(np.array([0.0, 4.0]), np.array([[0.0], [0.5]])), lambda *_: "")
ERROR = PoiseError(ErrorCode.NOT_FOLLOWING, "off its path")


class StubWatchdog:
    """Notes what it is asked for; sends no stop by itself."""

    ready = alive = True

    def __init__(self):
        self.armed, self.tripped, self.sent, self.refusal = False, [], None, None
        self.late, self.begins = 0, []

    def load(self, stops):
        pass

    def arm(self, stops, begin):
        if self.refusal is not None:
            raise self.refusal
        self.begins.append(begin)
        self.armed = len(self.begins) > self.late
        return self.armed

    def beat(self):
        pass

    def trip(self, error):
        self.tripped.append(error)
        return True

    def disarm(self):
        self.armed = False


class Bench:
    """An arm with one joint, whose publisher fails where a test says so."""

    joint_names = ("a",)

    def __init__(self):
        self.watchdog, self.sent, self.broken = StubWatchdog(), [], False
        joints = JointWatch(self)
        joints.add(10**9, self.joint_names, [0.1], 0.0)
        self.arm = CommandedArm(joints, self._send, self.watchdog)

    def _send(self, command):
        if self.broken:
            raise OSError("the publisher is gone")
        self.sent.append(command)


def test_the_watchdog_guards_the_arm_until_the_replacement_of_its_stop_is_sent():
    bench = Bench()
    bench.arm.move(STOPS, 0.0)
    bench.broken = True
    assert not bench.arm.hold(ERROR, 1.0)
    assert bench.watchdog.armed
    assert bench.watchdog.tripped == [ERROR]
    assert not bench.arm.hold(ERROR, 1.02)
    assert len(bench.watchdog.tripped) == 1
    bench.watchdog.sent = SentStop(ERROR, "too fast")
    assert bench.arm.hold(ERROR, 1.04)
    assert (bench.arm.stopped, bench.arm.excess) == (True, "too fast")


@pytest.mark.parametrize("way", ["hold", "stop"])
def test_a_stop_that_the_arm_sent_itself_ends_the_guard(way):
    bench = Bench()
    bench.arm.move(STOPS, 0.0)
    ticks = [getattr(bench.arm, way)(ERROR, 1.0 + 0.02 * tick) for tick in range(5)]
    assert ticks[-1]
    assert len(bench.sent) == 2
    assert not bench.watchdog.armed


def test_a_watchdog_that_is_late_is_asked_again_for_a_motion_that_begins_later():
    bench = Bench()
    bench.watchdog.late = 2
    bench.arm.move(STOPS, 0.0)
    assert np.all(np.diff(bench.watchdog.begins) > 0)
    assert [command.stamp for command in bench.sent] == bench.watchdog.begins[2:] == [bench.arm.begin]


@pytest.mark.parametrize("cause", ["publisher", "watchdog"])
def test_a_motion_that_was_not_sent_is_not_stopped_along_its_path(cause):
    bench = Bench()
    bench.broken = cause == "publisher"
    bench.watchdog.refusal = ERROR if cause == "watchdog" else None
    with pytest.raises((PoiseError, OSError)):
        bench.arm.move(STOPS, 0.0)
    bench.broken = False
    assert not bench.arm.moving
    assert not bench.watchdog.armed
    assert bench.arm.stop(ERROR, 2.0)
    assert bench.sent == []


def test_a_stop_of_a_motion_that_has_ended_ends_the_goal():
    bench = Bench()
    bench.arm.move(STOPS, 0.0)
    bench.arm.ended()
    bench.watchdog.sent = SentStop(ERROR, "")
    with pytest.raises(PoiseError, match="off its path"):
        bench.arm.check()


def test_the_arm_is_on_its_path_and_arrives_or_the_joint_is_named():
    bench = Bench()
    bench.arm.move(STOPS, 0.0)

    def at(seconds, position):
        bench.arm._joints.add(bench.arm.begin + round(seconds * 1e9), ("a",), [position], seconds)

    at(2.0, 0.25 + 0.01 + 0.15 * STOPS.motion.at(np.array([2.0])).velocity[0, 0])
    assert bench.arm.seconds == pytest.approx(2.0)
    bench.arm.require_on_path(0.02)
    assert not bench.arm.arrived(0.02, 1.0, "reach")
    with pytest.raises(PoiseError, match=r"a is 0\.045 off its path 2\.00 s into the motion") as raised:
        bench.arm.require_on_path(0.001)
    assert raised.value.code is ErrorCode.NOT_FOLLOWING
    at(4.5, 0.45)
    assert not bench.arm.arrived(0.02, 1.0, "reach")
    at(4.6, 0.49)
    assert bench.arm.arrived(0.02, 1.0, "reach")
    at(5.1, 0.45)
    with pytest.raises(PoiseError, match=r"0\.050 off the end of reach"):
        bench.arm.arrived(0.02, 1.0, "reach")
