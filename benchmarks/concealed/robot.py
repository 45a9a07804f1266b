"""The robot of the benchmark: a UR10 on a Ridgeback, as the URDF that bags carry and as a world for MuJoCo."""

import functools
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.concealed.payload import Payload
from poise.types import Array

URDF = Path(__file__).parents[2] / "poise" / "robot" / "models" / "ridgeback_ur10.urdf"
SENSOR = "ft_sensor"
LOAD = SENSOR
"""MuJoCo's body of this name begins at the measuring frame and holds the rigid payload."""

BASE_AXES = ("x", "y", "z", "yaw", "pitch", "roll")
ARM_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
ARM_LINKS = ("shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link")
DRIVEN = len(BASE_AXES) + len(ARM_JOINTS)
SPEED_LIMITS = np.array([2.09, 2.09, 3.14, 3.14, 3.14, 3.14])  # rad/s, of the URDF

ARMATURE = 1e12
"""kg m2 (or kg) added to every driven joint: it follows the commanded acceleration to 1e-9 under any load.

The force sensor does not see it: MuJoCo leaves armature out of the forces between bodies.
"""


# Left out: the base's joints (the base moves by odom) and the gripper (all beyond the sensor is payload).
LEFT_OUT_LINKS = ("odom", "base_x_link", "base_y_link", "gripper", "tcp")
LEFT_OUT_JOINTS = ("base_x", "base_y", "base_yaw", "gripper_mount", "tcp_joint")
IMU_PLACE = "0.2 0 0.25"


@functools.cache
def description() -> str:
    """The URDF for `robot_description`: root `base_link`, nothing beyond `ft_sensor`, an `imu_link` on the base."""
    root = ElementTree.fromstring(URDF.read_text(encoding="utf-8"))
    for tag, names in (("link", LEFT_OUT_LINKS), ("joint", LEFT_OUT_JOINTS)):
        for element in root.findall(tag):
            if element.get("name") in names:
                root.remove(element)
    ElementTree.SubElement(root, "link", name="imu_link")
    joint = ElementTree.SubElement(root, "joint", name="imu_mount", type="fixed")
    ElementTree.SubElement(joint, "parent", link="base_link")
    ElementTree.SubElement(joint, "child", link="imu_link")
    ElementTree.SubElement(joint, "origin", xyz=IMU_PLACE, rpy="0 0 0")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def build(payload: Payload, gravity_in_world: Array, step: float) -> mujoco.MjSpec:
    """The world before an effect changes it: driven base and arm, a rigid payload, sensors; nothing collides.

    The first DRIVEN coordinates are the base's (x, y, z, then yaw, pitch, roll, each about the axis that the one
    before left) and the arm's.

    Args:
        payload: all beyond the sensor.
        gravity_in_world: (3,) m/s2.
        step: s.
    """
    root = ElementTree.fromstring(description())
    extension = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(extension, "compiler", fusestatic="false", discardvisual="true")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.option.timestep = step
    spec.option.gravity = gravity_in_world
    spec.option.tolerance = 0.0  # the solver of stops weighs its progress against inertia, armature included
    for joint in spec.joints:
        joint.armature, joint.limited, joint.actfrclimited = ARMATURE, False, False
    base = spec.body("base_link")
    for name in BASE_AXES:
        kind = mujoco.mjtJoint.mjJNT_SLIDE if name in "xyz" else mujoco.mjtJoint.mjJNT_HINGE
        axis = np.eye(3)[{"x": 0, "y": 1, "z": 2, "yaw": 2, "pitch": 1, "roll": 0}[name]]
        base.add_joint(name=f"base_{name}", type=kind, axis=axis, armature=ARMATURE)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    set_inertia(spec.body(LOAD), payload)
    spec.body(LOAD).add_site(name=SENSOR)
    spec.body("imu_link").add_site(name="imu")
    kinds = mujoco.mjtSensor
    for name, kind, site in (
        ("force", kinds.mjSENS_FORCE, SENSOR),
        ("torque", kinds.mjSENS_TORQUE, SENSOR),
        ("gyro", kinds.mjSENS_GYRO, "imu"),
        ("accelerometer", kinds.mjSENS_ACCELEROMETER, "imu"),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)
    return spec


def set_inertia(body: mujoco.MjsBody, payload: Payload) -> None:
    """Give a body of a specification the mass of a payload whose frame is the body's."""
    matrix = payload.inertia
    body.mass, body.ipos, body.explicitinertial = payload.mass, payload.com, True
    body.fullinertia = [matrix[0, 0], matrix[1, 1], matrix[2, 2], matrix[0, 1], matrix[0, 2], matrix[1, 2]]
