"""The simulated arm: its messages fit its payload, repeat with their seed, and follow commands without a jump."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.fake_robots.arm import ArmOptions, Equipment, SimulatedArm, Waypoints
from poise.fake_robots.gripper import SimulatedGripper
from poise.recording.encoding import typestore
from poise.robot import RobotModel, find_urdf, frame_poses, motion_from_joints
from poise.simulation import FourierTrajectory, IdealRobot, JointNoise, home, wrench_noise

PAYLOAD = np.array([1.5, 0.03, -0.02, 0.12, 0.02, 0.001, 0.0, 0.018, 0.0, 0.006])
CLEAN = ArmOptions(wrench_noise("none", rate=100.0), JointNoise(rate=100.0))


def arm(name="fr3", trajectory=None, options=CLEAN, **world):
    model = RobotModel.from_file(name)
    return SimulatedArm(IdealRobot(model, PAYLOAD, **world), find_urdf(name).read_text(), trajectory, options)


def fourier(name="fr3", duration=8.0):
    return FourierTrajectory.random(RobotModel.from_file(name), np.random.default_rng(3), duration=duration)


def read(messages, topic, type_name):
    return [typestore().deserialize_cdr(m.data, type_name) for m in messages if m.topic == topic]


def joint_states(messages):
    return read(messages, "joint_states", "sensor_msgs/msg/JointState")


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_its_wrench_fits_its_payload_by_the_equations_of_motion():
    """f = m (g - a) - alpha x mc - omega x (omega x mc), from nothing but the messages."""
    options = ArmOptions(CLEAN.wrench_noise, CLEAN.joint_noise, end=8.0)
    messages = list(arm(trajectory=fourier(), options=options).messages())
    states = joint_states(messages)
    wrenches = read(messages, "wrench", "geometry_msgs/msg/WrenchStamped")
    assert [stamp(message) for message in wrenches] == [stamp(message) for message in states]
    model = RobotModel.from_file("fr3")
    stamps = np.array([stamp(state) for state in states])
    moved = motion_from_joints(model, stamps, states[0].name, np.array([state.position for state in states])).motion
    specific = moved.gravity_in_sensor() - moved.linear_acceleration_in_sensor
    omega, alpha = moved.angular_velocity_in_sensor, moved.angular_acceleration_in_sensor
    mass, first = PAYLOAD[0], PAYLOAD[1:4]
    force = mass * specific - np.cross(alpha, first) - np.cross(omega, np.cross(omega, first))
    xx, xy, xz, yy, yz, zz = PAYLOAD[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    torque = np.cross(first, specific) - alpha @ inertia - np.cross(omega, omega @ inertia)
    said = np.array([[w.wrench.force.x, w.wrench.force.y, w.wrench.force.z] for w in wrenches])
    assert np.sqrt(np.mean((said - force) ** 2)) < 5e-3  # of up to 20 N; the rest is the splines'
    said = np.array([[w.wrench.torque.x, w.wrench.torque.y, w.wrench.torque.z] for w in wrenches])
    assert np.sqrt(np.mean((said - torque) ** 2)) < 1e-3


def test_one_seed_is_one_sequence_of_bytes():
    sensor, encoders = wrench_noise("ft300", stamp_jitter=1e-3, drift_force=0.01), JointNoise(position=1e-4)
    noisy = [ArmOptions(sensor, encoders, seed=seed, end=1.0) for seed in (5, 5, 6)]
    runs = [list(arm(trajectory=fourier(), options=options).messages()) for options in noisy]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]
    assert [message.time for message in runs[0]] == sorted(message.time for message in runs[0])


def test_messages_come_at_the_stated_rates_until_the_end():
    options = ArmOptions(wrench_noise("axia80"), JointNoise(rate=125.0), end=2.0)
    messages = list(arm(trajectory=fourier(), options=options).messages())
    counts = {topic: sum(message.topic == topic for message in messages) for topic in ("wrench", "joint_states")}
    assert counts == {"wrench": 2001, "joint_states": 251}
    assert messages[0].topic == "robot_description"


def test_the_base_says_where_it_drives():
    moving = fourier("ridgeback_ur10")
    options = ArmOptions(CLEAN.wrench_noise, CLEAN.joint_noise, end=4.0)
    messages = list(arm("ridgeback_ur10", moving, options).messages())
    odometry = read(messages, "odom", "nav_msgs/msg/Odometry")
    states = joint_states(messages)
    model = RobotModel.from_file("ridgeback_ur10")
    rotation, place = frame_poses(model, np.array([state.position for state in states]), "base_link")
    for i in range(0, len(odometry), 40):
        pose, twist = odometry[i].pose.pose, odometry[i].twist.twist
        np.testing.assert_allclose([pose.position.x, pose.position.y], place[i, :2], atol=1e-12)
        turned = Rotation.from_quat([0, 0, pose.orientation.z, pose.orientation.w]).as_matrix()
        np.testing.assert_allclose(turned, rotation[i], atol=1e-12)
        in_world = rotation[i] @ [twist.linear.x, twist.linear.y, 0.0]
        np.testing.assert_allclose(in_world[:2], states[i].velocity[:2], atol=1e-12)


def run(stream, until):
    """Messages up to a time, s, of a stream that has no end."""
    return list(itertools.takewhile(lambda message: message.time < until * 1e9, stream))


def test_an_arm_without_a_trajectory_rests_at_home_until_commanded():
    robot = arm()
    stream = robot.messages()
    states = joint_states(run(stream, 0.5))
    np.testing.assert_allclose([state.position for state in states], np.tile(home(robot.model), (50, 1)))
    there = home(robot.model)[[0, 3]] + [0.4, -0.3]
    robot.command(Waypoints(["fr3_joint1", "fr3_joint4"], np.array([1.0]), there[None]))
    states = joint_states(run(stream, 3.0))
    np.testing.assert_allclose(np.array(states[-1].position)[[0, 3]], there, atol=1e-9)
    others = [1, 2, 4, 5, 6]
    stayed = np.array([state.position for state in states])[:, others]
    np.testing.assert_allclose(stayed, np.tile(home(robot.model)[others], (len(states), 1)))


def test_a_command_in_midst_of_a_motion_makes_no_jump():
    robot = arm(trajectory=fourier())
    stream = robot.messages()
    states = joint_states(run(stream, 3.0))
    robot.command(Waypoints(list(robot.model.joint_names), np.array([2.0]), home(robot.model)[None]))
    states += joint_states(run(stream, 5.5))
    velocity = np.array([s.velocity for s in states])
    assert np.abs(np.diff(velocity, axis=0)).max() < 0.01 * 6  # no more than 6 rad/s2
    np.testing.assert_allclose(states[-1].position, home(robot.model), atol=1e-9)


def test_an_empty_command_stops_the_arm():
    robot = arm(trajectory=fourier())
    stream = robot.messages()
    run(stream, 3.0)
    robot.command(Waypoints([], np.zeros(0), np.zeros((0, 0))))
    late = joint_states(run(stream, 4.5))[-20:]
    np.testing.assert_allclose([s.velocity for s in late], 0.0, atol=1e-12)


def test_a_stop_is_not_refused_at_the_limit_of_a_joint():
    """The path of the stop may pass the limit by rounding of its interpolation."""
    robot = arm()
    there = np.append(home(robot.model)[:-1], robot.model.upper[-1])
    for left in (0.01, 0.02):  # s of the motion
        run(robot.messages(), 0.1)
        _, begin = robot.command(Waypoints(list(robot.model.joint_names), np.array([1.1]), there[None]))
        robot._frontier = begin + 1.1 - left
        robot.command(Waypoints([], np.zeros(0), np.zeros((0, 0))))
        np.testing.assert_allclose(robot.states(begin + 2.0)[1].velocity, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("waypoints", "code"),
    [
        (Waypoints(["elbow"], np.array([1.0]), np.zeros((1, 1))), ErrorCode.JOINT_MISSING),
        (Waypoints(["fr3_joint4"], np.array([1.0]), np.array([[2.0]])), ErrorCode.JOINT_LIMIT),
        (Waypoints(["fr3_joint1"], np.array([0.01]), np.array([[2.0]])), ErrorCode.JOINT_LIMIT),
        (Waypoints(["fr3_joint1"], np.array([1.0, 1.0]), np.zeros((2, 1))), ErrorCode.BAD_INPUT),
        (Waypoints(["fr3_joint1"], np.array([1.0]), np.zeros((1, 2))), ErrorCode.BAD_INPUT),
        (Waypoints(["fr3_joint1"], np.array([1.0]), np.array([[np.nan]])), ErrorCode.BAD_INPUT),
    ],
)
def test_a_command_that_cannot_be_is_refused_and_the_arm_stays(waypoints, code):
    robot = arm()
    stream = robot.messages()
    run(stream, 0.2)
    with pytest.raises(InputError) as caught:
        robot.command(waypoints)
    assert caught.value.code is code
    np.testing.assert_allclose(joint_states(run(stream, 1.0))[-1].position, home(robot.model))


def test_a_grasp_changes_the_wrench_from_then_on():
    robot = arm()
    stream = robot.messages()
    before = read(run(stream, 0.3), "wrench", "geometry_msgs/msg/WrenchStamped")[-1].wrench.force
    robot.hold(IdealRobot(robot.model, 2 * PAYLOAD))
    after = read(run(stream, 0.6), "wrench", "geometry_msgs/msg/WrenchStamped")[-1].wrench.force
    np.testing.assert_allclose([after.x, after.y, after.z], 2 * np.array([before.x, before.y, before.z]))


def test_a_gripper_goes_where_it_is_told_no_faster_than_it_can_and_leaves_the_arm_as_it_is():
    options = ArmOptions(CLEAN.wrench_noise, CLEAN.joint_noise, end=2.0)
    model = RobotModel.from_file("fr3")
    gear = Equipment(SimulatedGripper("fingers", 0.8))
    held = SimulatedArm(IdealRobot(model, PAYLOAD), find_urdf("fr3").read_text(), fourier(), options, gear)
    stream = held.messages()
    first = list(itertools.islice(stream, 50))
    held.grip(["fingers"], 0.4)
    states = joint_states([*first, *stream])
    alone = joint_states(list(arm(trajectory=fourier(), options=options).messages()))
    assert [stamp(state) for state in states] == [stamp(state) for state in alone]
    assert list(states[0].name) == [*model.joint_names, "fingers"]
    for state, other in zip(states, alone, strict=True):
        for field in ("position", "velocity", "effort"):
            np.testing.assert_array_equal(getattr(state, field)[:-1], getattr(other, field))
    fingers = np.array([state.position[-1] for state in states])
    assert (fingers[0], fingers[-1]) == (0.0, 0.4)
    steps = np.diff(fingers)
    assert steps.max() == pytest.approx(0.8 / 100.0)
    assert 0.49 <= (steps > 0).sum() / 100.0 <= 0.52
    assert {round(state.velocity[-1], 9) for state in states} == {0.0, 0.8}
    with pytest.raises(InputError) as error:
        held.grip(["elbow"], 0.1)
    assert error.value.code is ErrorCode.JOINT_MISSING
    with pytest.raises(InputError, match="no gripper"):
        arm().grip(["fingers"], 0.1)
