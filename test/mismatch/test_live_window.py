"""The window of a running robot: what it keeps, what it drops, and that it is examined as a bag would be."""

from dataclasses import replace

import numpy as np
import pytest
from field_robots import ARM, Recorded

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia import InertialParameters
from poise.mismatch.answer import LiveWindow, diagnose, effects_called, examine
from poise.mismatch.reading import NominalModel, read_recording
from poise.recording import (
    JointStream,
    RecordingWriter,
    WrenchStream,
    encode_stream,
    encode_text,
    open_recording,
    typestore,
    write_recording,
)
from poise.robot import RobotModel
from poise.robot.model import find_urdf
from poise.robot.urdf import read_urdf
from poise.simulation import FourierTrajectory, IdealRobot, WrenchNoise, record

URDF = read_urdf(find_urdf("ridgeback_ur10"))
PHI = InertialParameters(2.0, np.array([0.0, 0.01, 0.1]), 0.01 * np.eye(3)).phi
SECOND = 10**9


def send_wrench(window, stamp, frame, wrench):
    stream = WrenchStream(np.array([stamp]), np.array([wrench], dtype=float), frame)
    window.add_wrench_message(next(encode_stream("wrench", stream))[1])


def send_joint_state(window, stamp, names, position, velocity, effort):
    """What was not measured is empty."""
    parts = (np.array([part if len(part) else [np.nan] * len(names)]) for part in (position, velocity, effort))
    stream = JointStream(np.array([stamp]), tuple(names), *parts)
    window.add_joint_state_message(next(encode_stream("joint_states", stream))[1])


def fed(window, seconds, start=0, rate=100, frame="ft_sensor"):
    """Wrenches and joint states of one joint."""
    for stamp in range(start, start + round(seconds * SECOND), SECOND // rate):
        send_wrench(window, stamp, frame, (stamp * 1e-9, 0, 0, 0, 0, 0))
        send_joint_state(window, stamp, ["a"], [0.1], [], [])
    return window


def test_only_the_last_seconds_are_kept():
    window = fed(LiveWindow(10.0), 25.0)
    assert window.seconds == pytest.approx(10.0, abs=0.02)
    streams = window.streams()
    joints = streams.joint_states(("a",))
    assert streams.wrench.stamps[-1] == window.newest
    assert joints.stamps[0] >= window.newest - 10 * SECOND
    assert np.isnan(joints.velocity).all()


def test_it_says_what_it_waits_for():
    window = LiveWindow(10.0)
    assert "wrench" in window.lacks
    send_wrench(window, 0, "ft", (0,) * 6)
    assert "joint state" in window.lacks
    send_joint_state(window, 0, ["a"], [0.0], [], [])
    assert "robot_description" in window.lacks
    window.description = URDF
    assert "8 s" in window.lacks
    assert fed(window, 9.0, SECOND, frame="ft").lacks == ""


def test_late_messages_are_counted_and_a_clock_that_began_anew_begins_anew():
    window = fed(LiveWindow(10.0), 9.0, start=100 * SECOND)
    newest = window.newest
    send_wrench(window, newest - SECOND, "ft_sensor", (0,) * 6)
    assert (window.late, window.newest) == (1, newest)
    send_wrench(window, SECOND, "ft_sensor", (0,) * 6)
    assert window.newest == SECOND
    assert window.seconds == 0.0


def test_wrenches_of_another_sensor_are_left_out():
    window = fed(LiveWindow(10.0), 1.0)
    send_wrench(window, 5 * SECOND, "other", (9,) * 6)
    assert window.foreign == 1
    assert window.newest < SECOND


def test_joint_states_come_in_the_order_asked_for_from_the_messages_that_hold_them_all():
    window = LiveWindow(10.0)
    send_wrench(window, 0, "ft", (0,) * 6)
    send_joint_state(window, 0, ["b", "a", "c"], [2.0, 1.0, 3.0], [0.2, 0.1, 0.3], [])
    send_joint_state(window, 1, ["a"], [9.0], [], [])
    send_joint_state(window, 2, ["a", "b"], [1.5, 2.5], [], [5.0, 6.0])
    joints = window.streams().joint_states(("a", "b"))
    assert joints.names == ("a", "b")
    np.testing.assert_array_equal(joints.position, [[1.0, 2.0], [1.5, 2.5]])
    np.testing.assert_array_equal(joints.velocity, [[0.1, 0.2], [np.nan, np.nan]])
    np.testing.assert_array_equal(joints.effort, [[np.nan, np.nan], [5.0, 6.0]])


def test_joints_that_no_message_holds_are_refused():
    window = fed(LiveWindow(10.0), 1.0)
    with pytest.raises(InputError) as raised:
        window.streams().joint_states(("a", "elbow"))
    assert raised.value.code is ErrorCode.JOINT_MISSING
    assert "elbow" in raised.value.message


@pytest.mark.parametrize("bias", [0.0, 3.0])
def test_a_window_gets_the_answer_of_its_recording_and_is_kept_when_something_is_found(tmp_path, bias):
    """Arm and gripper publish their states separately, as two drivers do."""
    robot = RobotModel.from_urdf(URDF, "ft_sensor")
    motion = FourierTrajectory.random(robot, np.random.default_rng(2), duration=12.0, speed=0.3)
    noise = WrenchNoise(rate=100.0, force=0.1, torque=0.005, bias=(bias, 0, 0, 0, 0, 0))
    made = record(IdealRobot(robot, PHI), motion, np.random.default_rng(3), noise)
    model = NominalModel(sensor_frame="ft_sensor", phi=PHI)
    # Efforts without the noise of motor currents would be another finding.
    joints = replace(made.joints, effort=np.full(made.joints.effort.shape, np.nan))
    window = LiveWindow(35.0)
    window.description = URDF
    for stamp, wrench in zip(made.wrench.stamps.tolist(), made.wrench.wrench_in_sensor, strict=True):
        send_wrench(window, stamp, "ft_sensor", wrench)
    for stamp, position, velocity in zip(joints.stamps.tolist(), joints.position, joints.velocity, strict=True):
        send_joint_state(window, stamp, joints.names, position, velocity, [])
        send_joint_state(window, stamp + 1000, ["finger"], [0.01], [], [])
    library = effects_called(["sensor_bias", "flywheel"])
    live = examine(window.streams(), model, library, tmp_path / "kept").found
    assert [finding.effect.name for finding in live.findings] == (["sensor_bias"] if bias else [])

    path = tmp_path / "window.mcap"
    write_recording(path, {"wrench": made.wrench, "joint_states": joints}, robot_description=URDF)
    read = read_recording(open_recording(path), model)
    recorded = diagnose(read.recorded, read.model, None, library)
    assert live.verdict == recorded.verdict
    proofs = [(each.main.proof.nominal, each.main.proof.augmented) for each in (live, recorded)]
    assert proofs[0] == proofs[1]
    assert [each.values for each in live.findings] == [each.values for each in recorded.findings]

    kept = list((tmp_path / "kept").glob("*.mcap"))
    assert len(kept) == bool(bias)
    if bias:
        assert live.findings[0].parameters["force_x"].value == pytest.approx(3.0, abs=0.3)
        assert len(open_recording(kept[0]).wrench()) == len(made.wrench)


def test_effects_are_called_by_their_names():
    assert effects_called([]) is None
    assert [effect.name for effect in effects_called(["cable", "slosh"])] == ["cable", "slosh"]
    with pytest.raises(InputError) as raised:
        effects_called(["gremlins"])
    assert raised.value.code is ErrorCode.BAD_INPUT
    assert "sensor_bias" in raised.value.message


@pytest.mark.parametrize("sensor", [True, False])
def test_messages_as_bytes_give_the_streams_of_their_recording(tmp_path, sensor):
    joints = Recorded(rate=250.0, seconds=9.0).joints()
    at = joints.stamps[::2]
    wrench = WrenchStream(at, np.sin(at * 1e-9)[:, None] * np.arange(1.0, 7.0), "link_3")
    window = LiveWindow(35.0, expects_wrench=sensor)
    window.description = ARM
    for _, data in encode_stream("joint_states", joints):
        window.add_joint_state_message(data)
    for _, data in encode_stream("wrench", wrench) if sensor else ():
        window.add_wrench_message(data)
    window.add_joint_state_message(next(encode_stream("joint_states", joints))[1])
    assert (window.late, window.lacks, window.frame_id) == (1, "", "link_3" if sensor else "")
    assert window.newest == (wrench if sensor else joints).stamps[-1]
    kept = window.snapshot()
    window.clear()
    streams = kept.streams()
    np.testing.assert_array_equal(streams.joint_states(joints.names).effort, joints.effort)
    with pytest.raises(InputError, match="no message holds"):
        streams.joint_states(("tail",))
    if sensor:
        np.testing.assert_array_equal(streams.wrench.wrench_in_sensor, wrench.wrench_in_sensor)
        np.testing.assert_array_equal(streams.wrench.stamps, wrench.stamps)
    else:
        assert streams.wrench is None
        live = examine(streams, NominalModel(), effects_called(["viscous_friction"]), tmp_path)
        assert {each.problem.signal for each in live.found.examinations} == {"effort"}
        assert live.start == live.reading.recorded.start


def trajectory_message(stamp, names, seconds, position):
    make = typestore().types
    moments = [divmod(round(each * SECOND), SECOND) for each in seconds]
    none = np.zeros(0)
    points = [
        make["trajectory_msgs/msg/JointTrajectoryPoint"](
            row, none, none, none, make["builtin_interfaces/msg/Duration"](*moment)
        )
        for row, moment in zip(position, moments, strict=True)
    ]
    header = make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](*divmod(stamp, SECOND)), "")
    message = make["trajectory_msgs/msg/JointTrajectory"](header, list(names), points)
    return bytes(typestore().serialize_cdr(message, "trajectory_msgs/msg/JointTrajectory"))


@pytest.mark.parametrize("kind", ["joint_commands", "joint_trajectory", "unstamped"])
def test_commands_are_those_of_the_recording(tmp_path, kind):
    joints = Recorded(rate=100.0, seconds=9.0).joints()
    path, window = tmp_path / "run.mcap", LiveWindow(35.0, expects_wrench=False)
    window.description = ARM
    # The joints follow 40 ms late.
    commands = replace(joints, stamps=joints.stamps - SECOND // 25)
    with RecordingWriter(path) as writer:
        writer.add_topic("robot_description", "std_msgs/msg/String")
        writer.write("robot_description", 0, encode_text(ARM))
        writer.add_topic("joint_states", "sensor_msgs/msg/JointState")
        for stamp, data in encode_stream("joint_states", joints):
            writer.write("joint_states", stamp, data)
            window.add_joint_state_message(data)
        if kind == "joint_commands":
            writer.add_topic(kind, "sensor_msgs/msg/JointState")
            for stamp, data in encode_stream(kind, commands):
                writer.write(kind, stamp, data)
                window.add_command_message(data)
        else:
            begin = int(commands.stamps[0])
            at = (commands.stamps - begin) * 1e-9
            data = trajectory_message(begin if kind == "joint_trajectory" else 0, joints.names, at, joints.position)
            writer.add_topic("joint_trajectory", "trajectory_msgs/msg/JointTrajectory")
            writer.write("joint_trajectory", begin, data)
            window.add_trajectory_message(data, begin)
    recorded = read_recording(open_recording(path), NominalModel())
    live = examine(window.streams(), NominalModel(), effects_called(["viscous_friction"]), tmp_path / "kept").reading
    assert live.recorded.commands is not None
    for part in ("seconds", "position"):
        here, there = (getattr(each.recorded.commands, part) for each in (live, recorded))
        np.testing.assert_array_equal(here, there)
    late = [[each for each in one.findings if each.kind == "command_tracking"] for one in (live, recorded)]
    assert late[0] == late[1]
    assert late[0][0].values[0] == pytest.approx(0.04, abs=0.005)


def test_a_window_without_usable_efforts_says_what_is_wrong_with_them():
    joints = Recorded(rate=100.0, seconds=9.0).joints()
    window = LiveWindow(35.0, expects_wrench=False)
    window.description = ARM
    for _, data in encode_stream("joint_states", replace(joints, effort=np.abs(joints.effort))):
        window.add_joint_state_message(data)
        window.add_command_message(data)
    with pytest.raises(NoAnswerError, match=r"effort.*late, gain"):
        examine(window.streams(), NominalModel(), effects_called(["viscous_friction"]))


def test_a_trajectory_lasts_beyond_the_window_that_it_was_sent_in():
    window = LiveWindow(10.0, expects_wrench=False)
    window.add_trajectory_message(trajectory_message(SECOND, ["a"], [0.0, 100.0], np.array([[0.0], [1.0]])), 0)
    for stamp in range(SECOND, 60 * SECOND, SECOND):
        send_joint_state(window, stamp, ["a"], [0.1], [], [])
    np.testing.assert_array_equal(window.streams().commands.position[:, 0], [0.0, 1.0])
    window.clear()
    send_joint_state(window, SECOND, ["a"], [0.1], [], [])
    assert window.streams().commands is None


def test_a_jump_of_the_clock_of_commands_forgets_no_states():
    window = fed(LiveWindow(10.0), 9.0, start=100 * SECOND)
    for stamp in (100 * SECOND, SECOND):
        window.add_trajectory_message(trajectory_message(stamp, ["a"], [0.0], np.zeros((1, 1))), 0)
    assert window.seconds > 8.9


def test_bytes_that_are_no_message_are_refused():
    window = LiveWindow(10.0)
    for data in (b"", b"\0\x01\0\0", b"\0\x07" + bytes(40)):
        with pytest.raises(InputError, match="no CDR"):
            window.add_wrench_message(data)


def test_when_the_sensor_stops_its_wrenches_are_forgotten():
    window = fed(LiveWindow(10.0), 9.0)
    window.expect_wrench(False)
    assert window.newest == 9 * SECOND - SECOND // 100
    assert window.streams().wrench is None
