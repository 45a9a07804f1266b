"""A base that carries objects: each change of its command stays below the limits, also when it stops."""

import numpy as np
import pytest

from poise.assembly import Assembly, Box, RigidObject, acceleration_limits
from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.geometry import Pose
from poise.manipulation import BaseExecution, BaseLimits, BaseTolerances, plan_base_motion

TICK = 0.02
TRAY = RigidObject("tray", Box((0.6, 0.4, 0.02)), Pose.from_vector([0, 0, 0.29, 0, 0, 0, 1]), fixed=True)
TALL = RigidObject("tall", Box((0.06, 0.04, 0.2)), Pose.from_vector([0.1, 0.05, 0.4, 0, 0, 0, 1]), mass=0.5)


def limits_of(*objects):
    found = acceleration_limits(Assembly((TRAY, *objects)), 72)
    return BaseLimits(found.normals[:, :2], found.offsets, found.angular_acceleration, found.angular_speed)


LIMITS = limits_of(TALL)


class Base:
    """An ideal holonomic base that does what it is commanded, or a share of it."""

    def __init__(self, path, share=0.8, holonomic=True, limits=LIMITS, start=(0.0, 0.0, 0.3)):
        self.pose, self.share, self.now, self.follows, self.speaks = np.array(start), share, 1.0, 1.0, True
        motion = plan_base_motion(self.pose, [np.array(each) for each in path], limits, 1.0, 1.0, share, holonomic)
        self.running = BaseExecution(motion, limits, share, BaseTolerances(), self.now)
        self.motion, self.commands, self.shares = motion, [np.zeros(3)], []

    def run(self, condition=lambda: False):
        running = self.running
        while not running.done and not condition():
            assert self.now < 100.0
            if self.speaks:
                running.add_odometry(self.pose, self.now)
            self.now += TICK
            command = running.tick(self.now)
            change = (command - self.commands[-1]) / TICK
            turning = running.limits.turning_share(change[2], command[2])
            self.shares.append(running.limits.share(change[:2]) + turning)
            self.commands.append(command)
            cosine, sine = np.cos(self.pose[2]), np.sin(self.pose[2])
            moved = np.array([[cosine, -sine], [sine, cosine]]) @ command[:2]
            self.pose = self.pose + self.follows * TICK * np.array([*moved, command[2]])
        return running


@pytest.mark.parametrize("holonomic", [True, False])
def test_it_arrives_and_never_takes_more_than_its_share_of_the_limits(holonomic):
    assert LIMITS.along(np.array([0.0, 1.0])) == pytest.approx(0.04 / 0.2 * 9.80665, rel=0.01)  # it topples
    base = Base([(1.0, 0.5, 1.0), (0.2, -0.6, -2.0)], holonomic=holonomic)
    running = base.run()
    assert running.error is None
    np.testing.assert_allclose(base.pose[:2], [0.2, -0.6], atol=0.02)
    assert abs(np.sin((base.pose[2] + 2.0) / 2)) < 0.02
    # While it turns and drives, a command in the frame of the base changes by the turning, too: a little is allowed.
    assert max(base.shares) < 0.8 * 1.05
    assert running.used <= 0.8 + 1e-9
    assert running.used > 0.4  # and it is not much slower than it has to be
    assert running.distance == pytest.approx(base.motion.length, rel=0.02)


@pytest.mark.parametrize("fault", ["cancel", "silence", "hindered"])
def test_it_comes_to_rest_within_the_limits(fault):
    base = Base([(3.0, 0.0, 0.3)])
    base.run(lambda: base.running.progress > 0.5)
    fast = np.linalg.norm(base.commands[-1])
    assert fast > 0.3
    if fault == "cancel":
        base.running.stop(PoiseError(ErrorCode.CANCELLED, "cancelled"))
    base.speaks = fault != "silence"
    base.follows = 0.0 if fault == "hindered" else 1.0
    running = base.run()
    code = {"cancel": ErrorCode.CANCELLED, "silence": ErrorCode.SENSOR_STALE, "hindered": ErrorCode.NOT_FOLLOWING}
    assert running.error.code == code[fault]
    assert not base.commands[-1].any()
    assert max(base.shares) < 0.8 * 1.05


def test_odometry_that_comes_late_is_judged_by_its_stamp():
    errors = []
    for stamped in (True, False):
        base = Base([(3.0, 0.0, 0.3)])
        running, measured = base.running, []
        base.speaks = False
        while not running.done:
            measured.append((base.pose, base.now))
            late = 20 if 0.4 < running.progress < 0.6 else 0  # ticks: 0.4 s
            pose, then = measured[-1 - late]
            running.add_odometry(pose, base.now, 500.0 + then if stamped else 0.0)
            end = base.now + 0.9 * TICK
            base.run(lambda end=end, base=base: base.now > end)
        errors.append(running.error)
    assert errors[0] is None
    assert errors[1].code is ErrorCode.NOT_FOLLOWING


def test_limits_that_fall_on_the_way_hold_from_then_on():
    base = Base([(3.0, 0.0, 0.3)])
    base.run(lambda: base.running.progress > 0.3)
    base.running.limits = BaseLimits(LIMITS.normals, LIMITS.offsets / 3, LIMITS.angular_acceleration, 1.0)
    base.shares.clear()
    base.run()
    assert max(base.shares) < 0.8 * 1.05


def test_what_sustains_nothing_is_not_carried_and_no_way_is_no_motion():
    for limits in (
        BaseLimits(LIMITS.normals, 0 * LIMITS.offsets, 1.0, 1.0),
        BaseLimits(LIMITS.normals, LIMITS.offsets, 0.0, 1.0),
    ):
        with pytest.raises(NoAnswerError) as caught:
            Base([(1.0, 0.0, 2.0)], limits=limits)
        assert caught.value.code == ErrorCode.UNSTABLE
    with pytest.raises(InputError) as empty:
        Base([(0.0, 0.0, 0.3)])
    assert empty.value.code == ErrorCode.EMPTY
    with pytest.raises(InputError) as wrong:
        Base([(np.nan, 0.0, 0.3)])
    assert wrong.value.code == ErrorCode.NOT_FINITE


def test_a_smaller_share_takes_longer_by_its_root():
    slow, fast = (Base([(0.5, 0.0, 0.3)], share=share).motion.duration for share in (0.2, 0.8))
    assert slow / fast == pytest.approx(2.0)


@pytest.mark.parametrize("left", [0.0, 0.01])
def test_a_base_whose_limits_are_gone_comes_to_rest_all_the_same(left):
    quick, late = Base([(3.0, 0.0, 0.3)]), Base([(3.0, 0.0, 0.3)])
    seconds = []
    for base in (quick, late):
        base.run(lambda base=base: base.running.progress > 0.5)
        begun = base.now
        base.running.stop(PoiseError(ErrorCode.CANCELLED, "cancelled"))
        if base is late:
            base.running.limits = LIMITS.times(left)
        base.run()
        seconds.append(base.now - begun)
    assert seconds[0] < seconds[1] < 4.2 * seconds[0]
    assert late.running.used > 1.0  # and it says so


def test_limits_that_are_no_numbers_or_incomplete_are_refused():
    nan, turning = np.nan, (LIMITS.angular_acceleration, 1.0)
    for code, values in (
        (ErrorCode.NOT_FINITE, (LIMITS.normals, nan * LIMITS.offsets, *turning)),
        (ErrorCode.NOT_FINITE, (nan * LIMITS.normals, LIMITS.offsets, *turning)),
        (ErrorCode.NOT_FINITE, (LIMITS.normals, LIMITS.offsets, nan, 1.0)),
        (ErrorCode.BAD_INPUT, (LIMITS.normals, LIMITS.offsets[:-1], *turning)),
    ):
        with pytest.raises(InputError) as caught:
            BaseLimits(*values)
        assert caught.value.code == code


@pytest.mark.parametrize("path", [[(1e200, 0.0, 0.3)], [(0.001 * n, 0.0, 0.3) for n in range(2000)]])
def test_a_path_without_end_is_refused(path):
    with pytest.raises(InputError) as caught:
        Base(path)
    assert caught.value.code == ErrorCode.BAD_INPUT
