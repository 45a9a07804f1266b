"""The file calibration.yaml, and a robot description with the zero offsets of the joints in it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from poise.calibration.adjustment import EYE
from poise.calibration.calibrate import HandEyeCalibration
from poise.errors import ErrorCode, InputError
from poise.robot import Mounting, parse_urdf

_KIND = "poise calibration"
_MOST_BYTES = 1_000_000


@dataclass(frozen=True, eq=False)
class StoredCalibration:
    """What a file says, as far as others use it.

    Args:
        hand_eye: the camera's optical frame in a link.
        offsets: that are added to joint positions, rad or m, by name.
        delay: s that the stamps of images are late.
    """

    hand_eye: Mounting
    offsets: dict[str, float]
    delay: float


def calibration_content(found: HandEyeCalibration, frame: str, provenance: dict[str, Any]) -> dict[str, Any]:
    """The content of the file; numbers in m, rad, s, pixels.

    Args:
        found: the calibration.
        frame: the camera's optical frame.
        provenance: what it was made from.
    """
    sigma, joints = np.sqrt(np.diag(found.covariance)), len(found.joint_names)
    x = found.parameters
    offsets = {
        name: {"offset": float(x.offsets[k]), "sigma": float(sigma[12 + k])}
        for k, name in enumerate(found.joint_names)
        if found.identified[k]
    }
    delay = {"delay": x.delay, "sigma": float(sigma[12 + joints])} if found.delay_identified else None
    return {
        "kind": _KIND,
        "hand_eye": {
            "link": found.link,
            "frame": frame,
            "pose": x.eye.vector.tolist(),
            "sigma_rotation": sigma[:3].tolist(),
            "sigma_translation": sigma[3:6].tolist(),
            "covariance": found.covariance[EYE, EYE].tolist(),
        },
        "board": {"pose_in_base": x.board.vector.tolist()},
        "joint_offsets": offsets,
        "camera_delay": delay,
        "not_identified": dict(found.reasons),
        "fit": {
            "views": found.views,
            "rejected_stamps": list(found.rejected),
            "rejected_corners": found.corners_rejected,
            "rms_pixels": found.rms,
            "corner_noise_pixels": found.noise,
            "views_disagree": found.disagreement,
            "board_scale": found.scale,
            "board_scale_sigma": found.scale_sigma,
            "chance_of_halves": found.halves,
            "notes": list(found.notes),
        },
        "provenance": provenance,
    }


def read_calibration(path: Path) -> StoredCalibration:
    """Read a file.

    Raises:
        InputError: FILE_UNREADABLE, BAD_INPUT naming what is wrong.
    """
    try:
        with path.open("rb") as file:
            content = yaml.safe_load(file.read(_MOST_BYTES))
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {str(error).splitlines()[0]}") from error
    try:
        if content["kind"] != _KIND:
            raise ValueError(f"its kind is {content['kind']!r}")
        eye = content["hand_eye"]
        mounting = Mounting.of_vector(str(eye["link"]), str(eye["frame"]), eye["pose"])
        offsets = {str(name): float(each["offset"]) for name, each in content["joint_offsets"].items()}
        delay = 0.0 if content["camera_delay"] is None else float(content["camera_delay"]["delay"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(ErrorCode.BAD_INPUT, f"{path} is not a file of poise calibrate: {error}") from error
    if not np.isfinite([*offsets.values(), delay]).all():
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: an offset or the delay is not finite")
    return StoredCalibration(mounting, offsets, delay)


def corrected_description(text: str, offsets: dict[str, float]) -> str:
    """A robot description in which joint positions mean what they measured: offsets are in the joints' origins.

    Args:
        text: URDF.
        offsets: that are added to joint positions, rad or m, by joint.

    Raises:
        InputError: as `parse_urdf`; JOINT_MISSING for a joint that it does not have.
    """
    parse_urdf(text)
    robot = ElementTree.fromstring(text.strip())
    joints = {joint.get("name", ""): joint for joint in robot.iter("joint")}
    if unknown := sorted(set(offsets) - set(joints)):
        raise InputError(ErrorCode.JOINT_MISSING, f"calibration: robot_description has no joint {', '.join(unknown)}")
    for name, offset in offsets.items():
        joint = joints[name]
        origin = joint.find("origin")
        if origin is None:
            origin = ElementTree.SubElement(joint, "origin")
        axis = joint.find("axis")
        along = _numbers("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
        along = along / np.linalg.norm(along)
        turn = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0")))
        shift = _numbers(origin.get("xyz", "0 0 0"))
        if joint.get("type") == "prismatic":
            shift = shift + turn.apply(along) * offset
        else:
            turn = turn * Rotation.from_rotvec(along * offset)
        origin.set("xyz", " ".join(repr(float(value)) for value in shift))
        origin.set("rpy", " ".join(repr(float(value)) for value in turn.as_euler("xyz")))
    return ElementTree.tostring(robot, encoding="unicode")


def _numbers(text: str) -> Any:
    return np.array([float(word) for word in text.split()])
