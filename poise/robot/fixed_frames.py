"""Which frames are fixed to the sensor's, and where: by the fixed joints of a URDF, and by tf that does not change."""

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from poise.geometry import Pose
from poise.recording import Recording
from poise.robot.frame_tree import FrameTree
from poise.robot.recorded_frames import is_constant
from poise.robot.urdf import parse_urdf


def fixed_frames(sensor_frame: str, recording: Recording | None, robot_description: str | None) -> dict[str, Pose]:
    """The pose of the sensor frame in every frame that is fixed to it; the sensor frame itself comes first.

    tf counts where the description, if there is one, does not hold the frame.

    Args:
        sensor_frame: the frame of the wrench.
        recording: with tf or tf_static; None: none.
        robot_description: a URDF; None: none.

    Raises:
        InputError: ROBOT_DESCRIPTION_INVALID; as `Recording.poses`.
    """
    tree = FrameTree(one_parent=False)
    known: set[str] = set()
    if robot_description is not None:
        _add_fixed_joints(tree, robot_description)
        known |= set(parse_urdf(robot_description).links)
    if recording is not None:
        for child in dict.fromkeys(child for child, _ in recording.frame_parents() if child not in known):
            stream = recording.poses(child)
            if is_constant(stream):
                place = stream.rotation_parent_child[-1:], stream.translation_parent_child[-1:]
                tree.add(stream.stamps[-1:], stream.parent, child, *place, fixed=True)
    names = dict.fromkeys([sensor_frame, *tree.frames, *(tree.top(name) for name in tree.frames)])
    poses = {name: tree.pose(sensor_frame, name, fixed_only=True) for name in names}
    return {name: pose for name, pose in poses.items() if pose is not None}


def frame_names(recording: Recording) -> list[str]:
    """The frames that a recording names: the links of its robot description, and those of tf; the outermost first.

    Raises:
        InputError: ROBOT_DESCRIPTION_INVALID; TYPE_MISMATCH when a message does not decode.
    """
    names = [name for pair in recording.frame_parents() for name in pair]
    if any(topic.strip("/").rpartition("/")[2] == "robot_description" for topic in recording.topics):
        names = [*reversed(parse_urdf(recording.robot_description()).links), *names]
    return list(dict.fromkeys(names))


def _add_fixed_joints(tree: FrameTree, text: str) -> None:
    parse_urdf(text)  # checks the names and numbers that are read below
    for joint in ElementTree.fromstring(text.strip()).iter("joint"):
        parent, child, origin = joint.find("parent"), joint.find("child"), joint.find("origin")
        if joint.get("type") != "fixed" or parent is None or child is None:
            continue
        place = {} if origin is None else origin.attrib
        turn = pin.rpy.rpyToMatrix(*(float(part) for part in place.get("rpy", "0 0 0").split()))
        shift = np.array([float(part) for part in place.get("xyz", "0 0 0").split()])
        tree.add([0], parent.get("link", ""), child.get("link", ""), turn[None], shift[None], fixed=True)
