"""The parameters of fake_robot: what they make, and what is said of those that cannot be."""

from pathlib import Path

import numpy as np
import pytest
import rclpy
import yaml
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from poise.errors import InputError
from poise.fake_robots.arm import SimulatedArm
from poise.fake_robots.bag_replay import BagSource
from poise.fake_robots.faults import parse_faults
from poise.fake_robots.parameters import PARAMETERS, PAYLOAD, make_source
from poise.nodes.parameters import declare_parameters

ROOT = Path(__file__).parents[2]
BAG = str(ROOT / "bags" / "kuka_at_rest.mcap")
SCENE = str(ROOT / "docs" / "scenes" / "tray.yaml")


@pytest.fixture(scope="module")
def context():
    context = Context()
    rclpy.init(context=context)
    yield context
    rclpy.shutdown(context=context)


def source_of(context, params):
    overrides = [Parameter(name, value=value) for name, value in params.items()]
    node = Node("fake_robot", context=context, parameter_overrides=overrides, start_parameter_services=False)
    try:
        values = declare_parameters(node, PARAMETERS, PAYLOAD)
        parse_faults(values["faults"])
        return make_source(values)
    finally:
        node.destroy_node()


def test_a_bag_or_an_arm_is_made(context):
    assert isinstance(source_of(context, {"bag": BAG, "topics": ["wrench"]}), BagSource)
    arm = source_of(context, {"mode": "arm", "robot": "ridgeback_ur10", "payload.mass": 1.0, "trajectory": "fourier"})
    assert isinstance(arm, SimulatedArm)
    assert set(arm.topics) == {"robot_description", "joint_states", "wrench", "odom", "tf", "tf_static"}
    plain = source_of(context, {"mode": "arm", "tf_rate": 0.0})
    assert set(plain.topics) == {"robot_description", "joint_states", "wrench"}
    seeing = {"mode": "arm", "world": SCENE, "gripper_joint": "finger_joint", "camera": True, "base": True}
    assert set(source_of(context, seeing).topics) >= {"odom", "world_truth", "camera/color/image_raw"}


def test_the_installed_parameter_file_finds_its_bag_from_any_folder(context, tmp_path, monkeypatch):
    (tmp_path / "share").mkdir()
    (tmp_path / "share" / "poise").symlink_to(ROOT)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    content = yaml.safe_load((ROOT / "config" / "fake_robot_replay.yaml").read_text())
    assert "wrench" in source_of(context, content["/**"]["ros__parameters"]).topics


def test_the_payload_is_given_about_its_centre_of_mass(context):
    payload = {"payload.mass": 2.0, "payload.com": [0.0, 0.0, 0.5], "payload.inertia": [0.1, 0.0, 0.0, 0.1, 0.0, 0.05]}
    arm = source_of(context, {"mode": "arm", **payload})
    np.testing.assert_allclose(arm.world.payload, [2, 0, 0, 1, 0.6, 0, 0, 0.6, 0, 0.05])


@pytest.mark.parametrize(
    ("params", "why"),
    [
        ({"mode": "dance"}, "dance"),
        ({}, "bag"),
        ({"bag": "/etc"}, "/etc"),
        ({"bag": "/etc/hostname"}, "/etc/hostname"),
        ({"bag": BAG, "rate": 0.0}, "rate"),
        ({"bag": BAG, "rate": 1}, "float"),
        ({"bag": BAG, "seed": -1}, "seed"),
        ({"bag": BAG, "topics": ["joint_states"]}, "joint_states"),
        ({"bag": BAG, "topics": "wrench"}, "list of words"),
        ({"bag": BAG, "faults": ["explode"]}, "explode"),
        ({"mode": "arm", "robot": "r2d2"}, "r2d2"),
        ({"mode": "arm", "sensor_frame": "nose"}, "nose"),
        ({"mode": "arm", "world": SCENE}, "gripper_joint"),
        ({"mode": "arm", "world": "/nowhere.yaml", "gripper_joint": "finger_joint"}, "/nowhere.yaml"),
        ({"mode": "arm", "world": SCENE, "gripper_joint": "finger_joint", "tool_frame": "nose"}, "nose"),
        ({"mode": "arm", "world": SCENE, "gripper_joint": "finger_joint", "riding": ["raft"]}, "raft"),
        ({"mode": "arm", "world": SCENE, "gripper_joint": "finger_joint", "riding": ["crate"]}, "is not fixed"),
        (
            {"mode": "arm", "world": SCENE, "gripper_joint": "f", "camera": True, "camera_pose": [0.0] * 7},
            "quaternion is zero",
        ),
        ({"mode": "arm", "camera": True}, "world"),
        ({"mode": "arm", "robot": "ridgeback_ur10", "base": True}, "base_x"),
        ({"mode": "arm", "base": True, "base_acceleration": [1.0, 0.0]}, "base_acceleration"),
        ({"mode": "arm", "gripper_joint": "finger_joint", "gripper_closed": 0.0}, "gripper_closed"),
        ({"mode": "arm", "sensor": "best"}, "best"),
        ({"mode": "arm", "sensor_bias": [1.0]}, "sensor_bias"),
        ({"mode": "arm", "payload.com": [0.0]}, "payload.com"),
        ({"mode": "arm", "gravity": [0.0, 0.0, float("nan")]}, "gravity"),
        ({"mode": "arm", "payload.mass": 1.0, "payload.inertia": [1.0, 0.0, 0.0, 0.1, 0.0, 0.1]}, "payload.inertia"),
    ],
)
def test_what_cannot_be_is_refused_by_its_name(context, params, why):
    with pytest.raises(InputError, match=why):
        source_of(context, params)
