"""Robot descriptions as they are in the field: zero axes, one joint, rails and lifts, mimic joints, mobile bases."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from urdf_parts import joint, link, robot

from poise.errors import ErrorCode, InputError
from poise.recording import JointStream, PoseStream
from poise.robot import BaseMotion, JointSource, RobotModel, base_motion_at, motion_from_joints, robot_of, sensor_motion

SECONDS = np.arange(0.0, 4.0, 0.01)
STAMPS = np.round(SECONDS * 1e9).astype(np.int64)
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def slide(name, parent, child, axis):
    return joint(name, "prismatic", parent, child).replace('xyz="0 0 1"', f'xyz="{AXES[axis]}"')


def arm(first: str) -> str:
    return robot(
        *(link(name, 1.0) for name in ("base", "carriage", "upper", "ft_sensor")),
        slide("slide", "base", "carriage", first),
        joint("shoulder", "revolute", "carriage", "upper", at="0.2 0 0.4"),
        joint("elbow", "revolute", "upper", "ft_sensor", at="0.3 0 0"),
    )


ONE_JOINT = robot(link("base"), link("ft_sensor", 1.0), joint("turn", "continuous", "base", "ft_sensor", at="0.3 0 0"))
PLANAR = robot(
    *(link(name) for name in ("world", "x", "y", "base", "ft_sensor")),
    slide("base_x", "world", "x", "x"),
    slide("base_y", "x", "y", "y"),
    joint("base_yaw", "continuous", "y", "base"),
    joint("shoulder", "revolute", "base", "ft_sensor", at="0.2 0 0.4"),
)


def test_a_fixed_joint_may_have_a_zero_axis_and_a_moving_one_may_not():
    text = robot(
        *(link(name) for name in ("base", "arm", "ft_sensor")),
        joint("turn", "continuous", "base", "arm"),
        joint("mount", "fixed", "arm", "ft_sensor", at="0 0 1").replace('xyz="0 0 1"/></joint', 'xyz="0 0 0"/></joint'),
    )
    zero = text.replace('<origin xyz="0 0 1"/><axis xyz="0 0 1"/>', '<origin xyz="0 0 1"/><axis xyz="0 0 0"/>')
    assert 'axis xyz="0 0 0"' in zero
    assert RobotModel.from_urdf(zero).joint_names == ("turn",)
    with pytest.raises(InputError, match="turn has an axis of length zero"):
        RobotModel.from_urdf(text.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', 1))


def test_a_robot_of_one_joint_has_a_motion_and_its_errors():
    rng = np.random.default_rng(1)
    rate = 2 * np.pi * 0.5
    position = 0.6 * np.sin(rate * SECONDS)[:, None] + rng.normal(size=(len(SECONDS), 1)) * 1e-5
    found = motion_from_joints(RobotModel.from_urdf(ONE_JOINT), STAMPS, ("turn",), position)
    truth = 0.6 * rate * np.cos(rate * SECONDS)
    np.testing.assert_allclose(found.motion.angular_velocity_in_sensor[:, 2], truth, atol=2e-3)
    assert np.all(found.angular_acceleration_sigma[:, 2] > 0.0)
    assert np.all(found.angular_acceleration_sigma[:, :2] == 0.0)


def test_a_continuous_joint_that_begins_anew_at_each_turn_has_the_motion_of_one_that_counts_on():
    model = RobotModel.from_urdf(ONE_JOINT)
    position = 3.0 * SECONDS[:, None] + 0.2 * np.sin(3.0 * SECONDS)[:, None]
    wrapped = np.remainder(position + np.pi, 2 * np.pi) - np.pi
    assert np.ptp(position) > 2 * np.pi
    source = JointSource(model)
    source.extend(STAMPS, ("turn",), wrapped)
    expected = motion_from_joints(model, STAMPS, ("turn",), position).motion
    moved = source.motion(int(STAMPS[0]), int(STAMPS[-1]))
    for found in (motion_from_joints(model, STAMPS, ("turn",), wrapped).motion, moved):
        np.testing.assert_allclose(found.angular_velocity_in_sensor, expected.angular_velocity_in_sensor, atol=1e-6)


@pytest.mark.parametrize("axis", ["x", "z"])
def test_a_rail_or_a_lift_under_an_arm_is_part_of_the_arm(axis):
    model = RobotModel.from_urdf(arm(axis))
    assert model.joint_names == ("slide", "shoulder", "elbow")
    assert model.base_joints == 0
    assert RobotModel.from_urdf(PLANAR).base_joints == 3


def joint_states(held):
    def read(wanted):
        missing = [name for name in wanted if name not in held]
        if missing:
            raise InputError(ErrorCode.JOINT_MISSING, f"lack {missing}")
        unknown = np.full((len(STAMPS), len(wanted)), np.nan)
        return JointStream(STAMPS, tuple(wanted), np.zeros((len(STAMPS), len(wanted))), unknown, unknown)

    return read


def odometry() -> PoseStream:
    place = np.column_stack([0.3 * SECONDS, 0.0 * SECONDS, 0.0 * SECONDS])
    return PoseStream(STAMPS, np.tile(np.eye(3), (len(STAMPS), 1, 1)), place, "odom", "base")


def test_odometry_moves_the_root_unless_joint_states_hold_the_base():
    lift, moving = arm("z"), odometry()
    every = ("slide", "shoulder", "elbow", "base_x", "base_y", "base_yaw")
    joints, model, used = robot_of(lift, "ft_sensor", joint_states(every), moving)
    assert (joints.names, model.base, used) == (("slide", "shoulder", "elbow"), "floating", moving)
    joints, model, used = robot_of(PLANAR, "ft_sensor", joint_states(every), moving)
    assert (model.base, used) == ("fixed", None)
    joints, model, used = robot_of(PLANAR, "ft_sensor", joint_states(("shoulder",)), moving)
    assert (joints.names, model.joint_names, model.base) == (("shoulder",), ("shoulder",), "floating")
    with pytest.raises(InputError):
        robot_of(arm("z"), "ft_sensor", joint_states(("elbow",)), moving)


def test_mimic_joints_follow_in_motion_and_in_the_errors():
    text = robot(
        *(link(name, 1.0) for name in ("base", "upper", "ft_sensor")),
        joint("turn", "continuous", "base", "upper"),
        joint(
            "bend", "continuous", "upper", "ft_sensor", '<mimic joint="turn" multiplier="-3" offset="0.2"/>', "1 0 0"
        ),
    )
    model = RobotModel.from_urdf(text)
    rng = np.random.default_rng(2)
    position = 0.4 * np.sin(3.0 * SECONDS)[:, None] + rng.normal(size=(len(SECONDS), 1)) * 1e-5
    found = motion_from_joints(model, STAMPS, model.joint_names, position)
    truth = -2.0 * 1.2 * np.cos(3.0 * SECONDS)  # turn plus minus three times turn
    np.testing.assert_allclose(found.motion.angular_velocity_in_sensor[:, 2], truth, atol=5e-3)
    alone = motion_from_joints(RobotModel.from_urdf(ONE_JOINT), STAMPS, ("turn",), position)
    ratio = found.angular_velocity_sigma[:, 2] / alone.angular_velocity_sigma[:, 2]
    np.testing.assert_allclose(ratio, 2.0, rtol=1e-6)


def test_a_driving_base_moves_the_sensor_and_a_resting_one_does_not():
    rng = np.random.default_rng(3)
    model = RobotModel.from_urdf(ONE_JOINT, base="floating")
    position = 0.3 * np.sin(2.0 * SECONDS)[:, None]
    yaw = 0.5 * np.sin(1.5 * SECONDS)
    noise = rng.normal(size=(len(SECONDS), 3)) * 1e-4
    for driving in (1.0, 0.0):
        pose = driving * np.column_stack([0.4 * np.sin(SECONDS), 0.2 * SECONDS, yaw])
        rates = driving * np.column_stack([0.4 * np.cos(SECONDS), 0.2 + 0 * SECONDS, 0.75 * np.cos(1.5 * SECONDS)])
        second = driving * np.column_stack([-0.4 * np.sin(SECONDS), 0 * SECONDS, -1.125 * np.sin(1.5 * SECONDS)])
        true_base = BaseMotion.planar(pose, rates, second)
        velocity, acceleration = 0.6 * np.cos(2.0 * SECONDS), -1.2 * np.sin(2.0 * SECONDS)
        truth = sensor_motion(model, STAMPS, position, velocity[:, None], acceleration[:, None], true_base)
        turns = Rotation.from_rotvec(np.outer(pose[:, 2] + noise[:, 2], [0.0, 0.0, 1.0])).as_matrix()
        source = JointSource(model)
        source.extend(STAMPS, ("turn",), position)
        assert source.newest is None  # the base is not known yet
        source.add_odometry(STAMPS, turns, np.column_stack([pose[:, :2] + noise[:, :2], np.zeros(len(SECONDS))]))
        found = source.measured(0, int(STAMPS[-1]))
        inner = slice(40, -40)
        error = found.motion.linear_acceleration_in_sensor - truth.linear_acceleration_in_sensor
        assert np.abs(error[inner]).max() < 0.1
        ratio = error[inner, :2] / found.linear_acceleration_sigma[inner, :2]
        assert np.sqrt(np.mean(ratio**2)) < 2.0
        if not driving:
            assert np.sqrt(np.mean(error[inner] ** 2)) < 2e-3


def test_the_twist_of_an_odometry_sharpens_the_acceleration_of_a_base_and_a_wrong_one_is_ignored():
    rng = np.random.default_rng(3)
    seconds = np.arange(0.0, 12.0, 0.02)
    rate = 2 * np.pi * 0.3
    place = np.stack([0.4 * np.sin(rate * seconds), 0.2 * np.cos(rate * seconds), 0 * seconds], axis=1)
    speed = np.stack([np.cos(rate * seconds), -0.5 * np.sin(rate * seconds), 0 * seconds], axis=1) * 0.4 * rate
    yaw = 0.5 * np.sin(rate * seconds)
    turn = Rotation.from_euler("z", yaw[:, None]).as_matrix()
    twist = np.zeros((len(seconds), 6))
    twist[:, :3] = np.einsum("nji,nj->ni", turn, speed)
    twist[:, 5] = 0.5 * rate * np.cos(rate * seconds)
    noisy = place + 1e-3 * rng.normal(size=place.shape) * [1, 1, 0]
    rates = twist + 5e-3 * rng.normal(size=twist.shape) * [1, 1, 0, 0, 0, 1]
    stamps = np.round(seconds * 1e9).astype(np.int64)
    wanted = np.arange(1.0, 11.0, 0.01)
    errors = []
    for given in (None, rates, 3.0 * rates):
        found = base_motion_at(PoseStream(stamps, turn, noisy, "odom", "base", given), 0, wanted)
        true = -(rate**2) * np.stack([0.4 * np.sin(rate * wanted), 0.2 * np.cos(rate * wanted), 0 * wanted], axis=1)
        here = np.einsum("nij,nj->ni", found.motion.rotation_world_base, found.motion.linear_acceleration_in_base)
        errors.append(float(np.sqrt(np.mean((here - true) ** 2))))
    assert errors[1] < 0.8 * errors[0]
    assert errors[2] == errors[0]
