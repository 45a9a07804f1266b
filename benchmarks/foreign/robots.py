"""The robots of the foreign profiles: a URDF for the tool, a tree of bodies for MuJoCo, a pose to move about."""

import copy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
MODELS = HERE.parents[1] / "poise" / "robot" / "models"
BASE_JOINTS = ("base_x", "base_y", "base_yaw")
TOOL_LINKS = ("gripper", "tcp")
"""Removed from each description: the payload of model.yaml is all that the sensor carries."""


@dataclass(frozen=True)
class Robot:
    """One robot.

    Args:
        file: URDF.
        frame: link that carries the payload, and the wrench sensor where there is one.
        joints: joints in the recording, in order.
        home: (J,) rad or m, the middle of the motion.
        reach: (J,) rad or m, the largest distance from home.
        speed: (J,) rad/s or m/s that a usual motion does not exceed.
        encoder: (J,) rad or m, one standard deviation of a good encoder.
        effort: (J,) N m or N, one standard deviation of a usual effort signal.
        payload: kg, lightest and heaviest.
    """

    file: Path
    frame: str
    joints: tuple[str, ...]
    home: tuple[float, ...]
    reach: tuple[float, ...]
    speed: tuple[float, ...]
    encoder: tuple[float, ...]
    effort: tuple[float, ...]
    payload: tuple[float, float]

    @property
    def prismatic(self) -> Array:
        """(J,) 1 for a linear joint, 0 for a rotary one."""
        kinds = {j.get("name"): j.get("type") for j in ElementTree.parse(self.file).getroot().findall("joint")}
        return np.array([float(kinds[name] == "prismatic") for name in self.joints])


_UR10 = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")

ROBOTS = {
    "ur10": Robot(
        file=MODELS / "ridgeback_ur10.urdf",
        frame="ft_sensor",
        joints=_UR10,
        home=(0.3, -1.3, 1.6, -1.0, -1.4, 0.2),
        reach=(0.9, 0.5, 0.6, 0.9, 0.9, 1.6),
        speed=(0.9, 0.7, 0.9, 1.4, 1.4, 1.8),
        encoder=(2e-5,) * 6,
        effort=(0.6, 0.6, 0.5, 0.12, 0.12, 0.12),
        payload=(1.2, 3.5),
    ),
    "fr3": Robot(
        file=MODELS / "fr3.urdf",
        frame="ft_sensor",
        joints=tuple(f"fr3_joint{i}" for i in range(1, 8)),
        home=(0.0, -0.5, 0.1, -2.0, 0.3, 1.9, 0.6),
        reach=(0.9, 0.5, 0.7, 0.6, 0.9, 0.7, 1.2),
        speed=(0.9, 0.8, 0.9, 0.9, 1.3, 1.3, 1.5),
        encoder=(1e-5,) * 7,
        effort=(0.15, 0.15, 0.12, 0.12, 0.05, 0.05, 0.04),
        payload=(0.6, 1.8),
    ),
    "xarm7": Robot(
        file=MODELS / "xarm7.urdf",
        frame="ft_sensor",
        joints=tuple(f"joint{i}" for i in range(1, 8)),
        home=(0.2, -0.3, 0.1, 1.2, 0.1, 1.0, 0.0),
        reach=(0.9, 0.5, 0.7, 0.6, 0.9, 0.8, 1.3),
        speed=(0.9, 0.7, 0.9, 0.9, 1.3, 1.2, 1.5),
        encoder=(3e-5,) * 7,
        effort=(0.3, 0.3, 0.25, 0.25, 0.1, 0.1, 0.08),
        payload=(0.6, 1.8),
    ),
    "one_axis": Robot(
        file=HERE / "rigs" / "one_axis.urdf",
        frame="flange",
        joints=("axis",),
        home=(0.2,),
        reach=(1.5,),
        speed=(2.2,),
        encoder=(2e-5,),
        effort=(0.08,),
        payload=(0.8, 2.5),
    ),
    "gantry": Robot(
        file=HERE / "rigs" / "gantry.urdf",
        frame="ft_sensor",
        joints=("x_axis", "y_axis", "z_axis"),
        home=(0.0, 0.0, 0.0),
        reach=(0.5, 0.35, 0.3),
        speed=(0.9, 0.9, 0.7),
        encoder=(5e-6,) * 3,
        effort=(1.5, 0.8, 0.5),
        payload=(1.0, 4.0),
    ),
}


@cache
def _tree(file: Path, root: str) -> ElementTree.Element:
    """The URDF without shapes, comments and tool, beginning at a link."""
    robot = ElementTree.parse(file).getroot()
    joints = robot.findall("joint")
    kept = [root]
    for name in kept:
        children = [j for j in joints if _end(j, "parent") == name and _end(j, "child") not in TOOL_LINKS]
        kept += [_end(j, "child") for j in children]
    pruned = ElementTree.Element("robot", {"name": robot.get("name", "robot")})
    for part in robot:
        named = part.get("name") if part.tag == "link" else None
        inside = part.tag == "joint" and {_end(part, "parent"), _end(part, "child")} <= set(kept)
        if named in kept or inside:
            pruned.append(copy.deepcopy(part))
    for link in pruned.findall("link"):
        for drawn in (*link.findall("visual"), *link.findall("collision")):
            link.remove(drawn)
    return pruned


def _end(joint: ElementTree.Element, tag: str) -> str:
    found = joint.find(tag)
    return "" if found is None else found.get("link", "")


def urdf(robot: Robot, root: str = "base_link") -> str:
    """URDF text from a link to the frame that carries the payload; the recording has it from base_link."""
    return ElementTree.tostring(_tree(robot.file, root), encoding="unicode")


def spec(robot: Robot, mobile: bool, gain: dict[str, float] | None = None) -> mujoco.MjSpec:
    """MuJoCo's tree of the robot without payload.

    Args:
        robot: which one.
        mobile: with the three joints of its base; otherwise base_link is fixed to the world.
        gain: factor on mass and inertia of each link, for a machine that differs from its data sheet.
    """
    root = copy.deepcopy(_tree(robot.file, "odom" if mobile else "base_link"))
    for joint in root.findall("joint"):
        for tag in ("limit", "dynamics", "safety_controller"):  # the reference keeps the limits
            for found in joint.findall(tag):
                joint.remove(found)
        if joint.get("type") == "revolute":
            joint.set("type", "continuous")
    for link in root.findall("link"):
        factor = (gain or {}).get(link.get("name", ""), 1.0)
        for tag in ("mass", "inertia"):
            for found in link.iterfind(f"inertial/{tag}"):
                for key, value in found.attrib.items():
                    found.set(key, repr(float(value) * factor))
    options = ElementTree.SubElement(root, "mujoco")
    settings = {"fusestatic": "false", "discardvisual": "false", "balanceinertia": "false", "strippath": "false"}
    ElementTree.SubElement(options, "compiler", settings)
    for joint in root.findall("joint"):
        if joint.get("type") == "prismatic":
            ElementTree.SubElement(joint, "limit", {"lower": "-1000", "upper": "1000", "effort": "0", "velocity": "0"})
    tree = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    for name in BASE_JOINTS[:2] if mobile else ():
        rail = tree.body(f"{name}_link")  # MuJoCo wants a mass on each moving body
        rail.mass, rail.inertia, rail.explicitinertial = 1e-3, np.full(3, 1e-5), True
    return tree


def links(robot: Robot) -> list[str]:
    """Names of the links that have a mass."""
    every = _tree(robot.file, "base_link").findall("link")
    return [str(link.get("name")) for link in every if link.find("inertial") is not None]
