"""The nominal world against pinocchio's own dynamics with the payload as a body, energy, and statics."""

import numpy as np
import pinocchio as pin
import pytest

from poise.inertia import InertialParameters
from poise.robot import BaseMotion, RobotModel, inertia_of, phi_of
from poise.robot.model import MODELS
from poise.simulation import FourierTrajectory, IdealRobot, JointMotion

ROBOTS = sorted(path.stem for path in MODELS.glob("*.urdf"))
PAYLOAD = phi_of(pin.Inertia(2.1, np.array([0.02, -0.03, 0.1]), np.diag([0.01, 0.012, 0.005]) + 1e-3))
GRAVITY = np.array([0.3, -0.2, -9.7])  # not along z, so that a wrong axis shows


def random_motion(model, n, seed):
    return JointMotion(*np.random.default_rng(seed).uniform(-2, 2, (3, n, len(model.joint_names))))


def with_payload_on_a_joint(name, tool):
    """The robot with a free joint at its sensor that carries the payload: RNEA's force there is the wrench."""
    model = RobotModel.from_file(name).pinocchio.copy()
    frame = model.frames[model.getFrameId("ft_sensor", pin.FrameType.BODY)]
    tool_inertia = inertia_of(tool)
    joint = model.addJoint(frame.parentJoint, pin.JointModelFreeFlyer(), frame.placement, "payload")
    model.appendBodyToJoint(joint, inertia_of(PAYLOAD), pin.SE3.Identity())
    if tool[0] > 0:  # the gripper hangs on the sensor: take it off the last link
        model.inertias[frame.parentJoint] -= frame.placement.act(tool_inertia)
        model.appendBodyToJoint(joint, tool_inertia, pin.SE3.Identity())
    model.gravity.linear = GRAVITY
    return model


@pytest.mark.parametrize("tool_in_wrench", [True, False])
@pytest.mark.parametrize("name", ROBOTS)
def test_wrench_is_what_newton_and_euler_ask_of_a_joint_at_the_sensor(name, tool_in_wrench):
    robot = RobotModel.from_file(name)
    joints = random_motion(robot, 20, 1)
    truth = IdealRobot(robot, PAYLOAD, GRAVITY, tool_in_wrench).simulate(np.arange(20), joints)
    model = with_payload_on_a_joint(name, robot.load_in_sensor if tool_in_wrench else np.zeros(10))
    data, rest = model.createData(), np.array([0, 0, 0, 0, 0, 0, 1.0])
    q = robot.configuration(joints.position)
    for i in range(20):
        v, a = (np.concatenate([part[i], np.zeros(6)]) for part in (joints.velocity, joints.acceleration))
        torque = pin.rnea(model, data, np.concatenate([q[i], rest]), v, a)
        # The joint holds the payload with this force; the payload pulls on the sensor with its opposite.
        np.testing.assert_allclose(truth.wrench_in_sensor[i], -torque[-6:], rtol=1e-9, atol=1e-8)
        if tool_in_wrench:  # then both carry the same bodies
            np.testing.assert_allclose(truth.effort[i], torque[:-6], rtol=1e-9, atol=1e-8)


def test_efforts_put_in_as_much_energy_as_the_robot_gains():
    robot = RobotModel.from_file("xarm7")
    ideal = IdealRobot(robot, PAYLOAD, [0, 0, -9.81])  # pinocchio's own gravity
    seconds = np.linspace(0.0, 3.0, 6001)
    joints = FourierTrajectory.random(robot, np.random.default_rng(2), duration=6.0).at(seconds)
    power = np.sum(ideal.effort(joints) * joints.velocity, axis=1)
    work = float(np.sum((power[1:] + power[:-1]) / 2 * np.diff(seconds)))
    model = robot.pinocchio.copy()
    frame = model.frames[robot.frame_id("ft_sensor")]
    model.inertias[frame.parentJoint] += frame.placement.act(inertia_of(PAYLOAD))
    data = model.createData()

    def energy(i):
        q = robot.configuration(joints.position[[i]])[0]
        return pin.computeKineticEnergy(model, data, q, joints.velocity[i]) + pin.computePotentialEnergy(model, data, q)

    assert work == pytest.approx(energy(-1) - energy(0), rel=1e-4)


def test_a_payload_at_rest_weighs_on_the_sensor_and_turns_it():
    robot = RobotModel.from_file("fr3")
    zeros = np.zeros((1, 7))
    truth = IdealRobot(robot, PAYLOAD).simulate(np.zeros(1, dtype=np.int64), JointMotion(zeros, zeros, zeros))
    downwards = truth.motion.rotation_world_sensor[0].T @ [0, 0, -2.1 * 9.80665]
    np.testing.assert_allclose(truth.wrench_in_sensor[0, :3], downwards, atol=1e-12)
    np.testing.assert_allclose(truth.wrench_in_sensor[0, 3:], np.cross([0.02, -0.03, 0.1], downwards), atol=1e-12)


def test_a_falling_payload_weighs_nothing():
    robot = RobotModel.from_file("fr3", base="floating")
    zeros = np.zeros((1, 3))
    falling = BaseMotion(np.eye(3)[None], zeros, zeros, zeros, np.array([[0, 0, -9.80665]]), zeros)
    still = np.zeros((1, 7))
    truth = IdealRobot(robot, PAYLOAD, tool_in_wrench=True).simulate(
        np.zeros(1, dtype=np.int64), JointMotion(still, still, still), falling
    )
    np.testing.assert_allclose(truth.wrench_in_sensor, 0.0, atol=1e-12)
    np.testing.assert_allclose(truth.effort, 0.0, atol=1e-10)


def test_an_empty_hand_gives_finite_efforts_equal_to_those_of_a_vanishing_load():
    robot = RobotModel.from_file("ridgeback_ur10")
    zeros = np.zeros((1, len(robot.joint_names)))
    joints = JointMotion(zeros, zeros, zeros)
    empty = IdealRobot(robot).effort(joints)
    light = IdealRobot(robot, InertialParameters(1e-9, np.zeros(3), 1e-12 * np.eye(3)).phi).effort(joints)
    np.testing.assert_allclose(empty, light, atol=1e-6)
