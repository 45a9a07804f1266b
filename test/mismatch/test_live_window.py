"""The window of a running robot: what it keeps, what it drops, and that it is examined as a bag would be."""

from dataclasses import replace

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.inertia import InertialParameters
from poise.mismatch.answer import LiveWindow, effects_called, examine
from poise.mismatch.reading import NominalModel
from poise.recording import open_recording
from poise.robot import RobotModel
from poise.robot.model import find_urdf
from poise.robot.urdf import read_urdf
from poise.simulation import FourierTrajectory, IdealRobot, WrenchNoise, record

URDF = read_urdf(find_urdf("ridgeback_ur10"))
PHI = InertialParameters(2.0, np.array([0.0, 0.01, 0.1]), 0.01 * np.eye(3)).phi
SECOND = 10**9


def fed(window, seconds, start=0, rate=100, frame="ft_sensor"):
    """Wrenches and joint states of one joint."""
    for stamp in range(start, start + round(seconds * SECOND), SECOND // rate):
        window.add_wrench(stamp, frame, (stamp * 1e-9, 0, 0, 0, 0, 0))
        window.add_joint_state(stamp, ["a"], [0.1], [], [])
    return window


def test_only_the_last_seconds_are_kept():
    window = fed(LiveWindow(10.0), 25.0)
    assert window.seconds == pytest.approx(10.0, abs=0.02)
    streams = window.streams()
    assert streams["wrench"].stamps[-1] == window.newest
    assert streams["joint_states"].stamps[0] >= window.newest - 10 * SECOND
    assert np.isnan(streams["joint_states"].velocity).all()


def test_it_says_what_it_waits_for():
    window = LiveWindow(10.0)
    assert "wrench" in window.lacks
    window.add_wrench(0, "ft", (0,) * 6)
    assert "joint state" in window.lacks
    window.add_joint_state(0, ["a"], [0.0], [], [])
    assert "robot_description" in window.lacks
    window.description = URDF
    assert "8 s" in window.lacks
    assert fed(window, 9.0, SECOND, frame="ft").lacks == ""


def test_late_messages_are_counted_and_a_clock_that_began_anew_begins_anew():
    window = fed(LiveWindow(10.0), 9.0, start=100 * SECOND)
    newest = window.newest
    window.add_wrench(newest - SECOND, "ft_sensor", (0,) * 6)
    assert (window.late, window.newest) == (1, newest)
    window.add_wrench(SECOND, "ft_sensor", (0,) * 6)
    assert window.newest == SECOND
    assert window.seconds == 0.0


def test_wrenches_of_another_sensor_are_left_out():
    window = fed(LiveWindow(10.0), 1.0)
    window.add_wrench(5 * SECOND, "other", (9,) * 6)
    assert window.foreign == 1
    assert window.newest < SECOND


def test_joint_states_come_in_the_order_of_the_last_and_lacking_ones_are_left_out():
    window = LiveWindow(10.0)
    window.add_wrench(0, "ft", (0,) * 6)
    window.add_joint_state(0, ["b", "a", "c"], [2.0, 1.0, 3.0], [0.2, 0.1, 0.3], [])
    window.add_joint_state(1, ["a"], [9.0], [], [])
    window.add_joint_state(2, ["a", "b"], [1.5, 2.5], [], [5.0, 6.0])
    joints = window.streams()["joint_states"]
    assert joints.names == ("a", "b")
    np.testing.assert_array_equal(joints.position, [[1.0, 2.0], [1.5, 2.5]])
    np.testing.assert_array_equal(joints.velocity, [[0.1, 0.2], [np.nan, np.nan]])
    np.testing.assert_array_equal(joints.effort, [[np.nan, np.nan], [5.0, 6.0]])


@pytest.mark.parametrize("bias", [0.0, 3.0])
def test_a_window_is_examined_as_a_bag_and_kept_when_something_is_found(tmp_path, bias):
    robot = RobotModel.from_urdf(URDF, "ft_sensor")
    motion = FourierTrajectory.random(robot, np.random.default_rng(2), duration=12.0, speed=0.3)
    noise = WrenchNoise(rate=100.0, force=0.1, torque=0.005, bias=(bias, 0, 0, 0, 0, 0))
    made = record(IdealRobot(robot, PHI), motion, np.random.default_rng(3), noise)
    model = NominalModel(sensor_frame="ft_sensor", phi=PHI)
    # Efforts without the noise of motor currents would be another finding.
    joints = replace(made.joints, effort=np.full(made.joints.effort.shape, np.nan))
    streams = {"wrench": made.wrench, "joint_states": joints}
    found = examine(streams, URDF, model, effects_called(["sensor_bias", "flywheel"]), tmp_path).found
    kept = list(tmp_path.glob("*.mcap"))
    wrench = [each for each in found.examinations if each.problem.signal == "wrench"]
    assert [finding.effect.name for finding in wrench[0].findings] == (["sensor_bias"] if bias else [])
    if bias:
        assert found.findings[0].parameters["force_x"].value == pytest.approx(3.0, abs=0.3)
        assert len(open_recording(kept[0]).wrench()) == len(made.wrench)
    else:
        assert found.verdict == "none"
        assert not kept


def test_effects_are_called_by_their_names():
    assert effects_called([]) is None
    assert [effect.name for effect in effects_called(["cable", "slosh"])] == ["cable", "slosh"]
    with pytest.raises(InputError) as raised:
        effects_called(["gremlins"])
    assert raised.value.code is ErrorCode.BAD_INPUT
    assert "sensor_bias" in raised.value.message
