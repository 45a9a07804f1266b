"""The motion of the sensor against closed forms, an independent chain, finite differences and a moving base."""

from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from urdf_parts import joint, link, robot

from poise.errors import ErrorCode, InputError
from poise.robot import (
    BaseMotion,
    RobotModel,
    frame_poses,
    motion_from_joints,
    motion_from_poses,
    motion_sigma,
    sensor_motion,
)
from poise.robot.model import MODELS, find_urdf

FIELDS = ("angular_velocity_in_sensor", "angular_acceleration_in_sensor", "linear_acceleration_in_sensor")
ROBOTS = sorted(path.stem for path in MODELS.glob("*.urdf"))


def random_motion(model, n, seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, 2, (3, n, len(model.joint_names)))


def newton_euler_chain(name, q, v, a):
    """Attitude, rates and acceleration of the sensor's origin by the outward recursion, read from the URDF by itself.

    All vectors in world axes: Craig 2005, equations 6.45-6.48, with revolute and prismatic joints.
    """
    tree = ElementTree.parse(find_urdf(name)).getroot()
    joint_to = {j.find("child").get("link"): j for j in tree.findall("joint")}
    chain, at = [], "ft_sensor"
    while at in joint_to:
        chain.insert(0, joint_to[at])
        at = joint_to[at].find("parent").get("link")
    rotation, omega, alpha, acceleration = np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3)
    index = 0
    for element in chain:
        origin = element.find("origin")
        place = {} if origin is None else origin.attrib
        xyz, rpy = (np.array([float(x) for x in place.get(key, "0 0 0").split()]) for key in ("xyz", "rpy"))
        arm = rotation @ xyz
        acceleration = acceleration + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
        rotation = rotation @ Rotation.from_euler("xyz", rpy).as_matrix()
        if element.get("type") == "fixed":
            continue
        axis = np.array([float(x) for x in element.find("axis").get("xyz").split()])
        along, (qi, vi, ai) = rotation @ axis, (q[index], v[index], a[index])
        index += 1
        if element.get("type") == "prismatic":
            arm = along * qi
            acceleration = acceleration + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
            acceleration = acceleration + 2 * np.cross(omega, along * vi) + along * ai
        else:
            alpha = alpha + along * ai + np.cross(omega, along * vi)
            omega = omega + along * vi
            rotation = rotation @ Rotation.from_rotvec(axis * qi).as_matrix()
    return rotation, rotation.T @ omega, rotation.T @ alpha, rotation.T @ acceleration


@pytest.mark.parametrize("name", ROBOTS)
def test_agrees_with_an_independent_chain(name):
    model = RobotModel.from_file(name)
    q, v, a = random_motion(model, 20, 1)
    motion = sensor_motion(model, np.arange(20), q, v, a)
    for i in range(20):
        rotation, omega, alpha, acceleration = newton_euler_chain(name, q[i], v[i], a[i])
        np.testing.assert_allclose(motion.rotation_world_sensor[i], rotation, atol=1e-9)
        np.testing.assert_allclose(motion.angular_velocity_in_sensor[i], omega, atol=1e-9)
        np.testing.assert_allclose(motion.angular_acceleration_in_sensor[i], alpha, atol=1e-8)
        np.testing.assert_allclose(motion.linear_acceleration_in_sensor[i], acceleration, atol=1e-8)


def test_a_turning_arm_has_its_centripetal_and_tangential_acceleration():
    shoulder, wrist = joint("j", "revolute", "base", "arm"), joint("k", "fixed", "arm", "ft_sensor", at="0.8 0 0")
    model = RobotModel.from_urdf(robot(link("base"), link("arm"), link("ft_sensor"), shoulder, wrist))
    motion = sensor_motion(model, [0], [[0.3]], [[2.0]], [[5.0]])
    np.testing.assert_allclose(motion.linear_acceleration_in_sensor[0], [-0.8 * 4.0, 0.8 * 5.0, 0], atol=1e-12)
    np.testing.assert_allclose(motion.angular_velocity_in_sensor[0], [0, 0, 2.0])


@pytest.mark.parametrize("name", ROBOTS)
def test_is_the_second_difference_of_the_poses(name):
    model = RobotModel.from_file(name)
    q, v, a = random_motion(model, 5, 2)
    h = 1e-4
    motion = sensor_motion(model, np.arange(5), q, v, a)
    rotation, here = frame_poses(model, q)
    (behind, before), (ahead, after) = (frame_poses(model, q + s * h * v + 0.5 * h * h * a) for s in (-1, 1))
    in_world = (after - 2 * here + before) / h**2
    in_sensor = np.einsum("nji,nj->ni", rotation, in_world)
    np.testing.assert_allclose(motion.linear_acceleration_in_sensor, in_sensor, atol=2e-4 * np.abs(in_sensor).max())
    turn = Rotation.from_matrix(np.einsum("nji,njk->nik", behind, ahead)).as_rotvec() / (2 * h)
    np.testing.assert_allclose(motion.angular_velocity_in_sensor, turn, atol=1e-5 * np.abs(turn).max())


def test_a_floating_base_moves_the_sensor_as_planar_joints_do():
    """The Ridgeback's own x, y, yaw joints against the same arm on a base whose motion is given."""
    text = find_urdf("ridgeback_ur10").read_text()
    whole = RobotModel.from_urdf(text)
    tree = ElementTree.fromstring(text)
    for element in list(tree):
        if element.get("name") in ("odom", "base_x_link", "base_y_link", "base_x", "base_y", "base_yaw"):
            tree.remove(element)
    ridden = RobotModel.from_urdf(ElementTree.tostring(tree, encoding="unicode"), base="floating")
    assert ridden.joint_names == whole.joint_names[3:]
    q, v, a = random_motion(whole, 10, 3)
    expected = sensor_motion(whole, np.arange(10), q, v, a)
    base = BaseMotion.planar(q[:, :3], v[:, :3], a[:, :3])
    actual = sensor_motion(ridden, np.arange(10), q[:, 3:], v[:, 3:], a[:, 3:], base)
    for field in ("rotation_world_sensor", *FIELDS):
        np.testing.assert_allclose(getattr(actual, field), getattr(expected, field), atol=1e-9)


def test_a_base_that_moves_needs_a_model_that_lets_it():
    model = RobotModel.from_file("fr3")
    zeros = np.zeros((2, 3))
    with pytest.raises(InputError, match="floating") as caught:
        sensor_motion(model, [0, 1], *np.zeros((3, 2, 7)), base=BaseMotion.planar(zeros, zeros, zeros))
    assert caught.value.code is ErrorCode.UNSUPPORTED


def test_a_sample_that_is_not_finite_is_named():
    velocity = np.zeros((4, 7))
    velocity[2, 5] = np.nan
    with pytest.raises(InputError, match=r"fr3_joint6.*sample 2"):
        sensor_motion(RobotModel.from_file("fr3"), np.arange(4), np.zeros((4, 7)), velocity, np.zeros((4, 7)))


def test_noise_of_the_motion_is_that_of_many_noisy_joints():
    model = RobotModel.from_file("xarm7")
    rng = np.random.default_rng(4)
    q = rng.uniform(-1, 1, (1, 7))
    sigma_v, sigma_a = rng.uniform(1e-3, 1e-2, (2, 1, 7))
    n = 4000
    v, a = rng.normal(size=(2, n, 7)) * np.stack([sigma_v, sigma_a])
    cloud = sensor_motion(model, np.arange(n), np.tile(q, (n, 1)), v, a)
    for field, sigma in zip(FIELDS, motion_sigma(model, q, sigma_v, sigma_a), strict=True):
        np.testing.assert_allclose(getattr(cloud, field).std(axis=0), sigma[0], rtol=0.06)


def test_joint_states_and_poses_of_one_motion_give_one_answer():
    model = RobotModel.from_file("fr3")
    seconds = np.arange(0, 6, 0.008)
    stamps = np.round(seconds * 1e9).astype(np.int64)
    rates = np.array([0.9, 1.3, 0.7, 1.1, 1.7, 0.8, 1.9])
    q = 0.5 * np.sin(np.outer(seconds, rates))
    exact = sensor_motion(model, stamps, q, 0.5 * rates * np.cos(np.outer(seconds, rates)), -(rates**2) * q)
    joints = motion_from_joints(model, stamps, model.joint_names, q)
    poses = motion_from_poses(stamps, *frame_poses(model, q))
    for measured in (joints, poses):
        for field in FIELDS:
            np.testing.assert_allclose(
                getattr(measured.motion, field)[30:-30], getattr(exact, field)[30:-30], atol=2e-4
            )
