"""XML files of worlds as trees, and numbers in them."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.inertia import InertialParameters
from poise.inertia.model import symmetric
from poise.types import Array


def read_xml(path: Path, root: str) -> ET.Element:
    """The root element of a file.

    Raises:
        InputError: FILE_UNREADABLE; FILE_CORRUPT for no XML, a document type (its entities can grow without bound), or
            another root.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: document types and entities are not read; remove them")
    try:
        found = ET.fromstring(content)
    except ET.ParseError as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: not XML: {error}") from error
    if found.tag != root:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: the root element is <{found.tag}>, expected <{root}>")
    return found


def numbers_of(text: str | None, count: int, where: str, default: str = "") -> Array:
    """(count,) numbers with blanks between; those of `default` for no text.

    Raises:
        InputError: BAD_INPUT for anything else.
    """
    words = (text or default).split()
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: {text!r:.60} is not {count} numbers") from error
    if len(values) != count or not np.all(np.isfinite(values)):
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: {text!r:.60} is not {count} finite numbers")
    return values


def direction_of(text: str | None, where: str) -> Array:
    """(3,) three numbers that are not all 0; z for no text.

    Raises:
        InputError: BAD_INPUT for anything else.
    """
    found = numbers_of(text, 3, where, "0 0 1")
    if not found.any():
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: {text!r} has no direction")
    return found


AXES_OF_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def inertial_at(mass: float, pose: Pose, six: Array | None) -> InertialParameters:
    """Of a body in its link's frame: the pose is that of its centre of mass and of the axes of its inertia.

    Args:
        mass: kg.
        pose: in the link's frame.
        six: (6,) in the order of `AXES_OF_INERTIA`, kg m2; None: not known.
    """
    inertia = np.full((3, 3), np.nan) if six is None else symmetric(six)
    return InertialParameters(mass, np.zeros(3), inertia).in_frame(pose.rotation, pose.translation)


def pose_of_rpy(xyz: Array, rpy: Array) -> Pose:
    """A pose of a translation, m, and of roll, pitch and yaw about fixed axes, rad (URDF and SDFormat)."""
    return Pose(Rotation.from_euler("xyz", rpy).as_matrix(), np.asarray(xyz, dtype=np.float64))


def xyz_rpy_of(pose: Pose) -> str:
    """The six numbers of `pose_of_rpy`, with blanks between."""
    angles = Rotation.from_matrix(pose.rotation).as_euler("xyz", suppress_warnings=True)
    return " ".join(repr(float(value)) for value in (*pose.translation, *angles))
