"""The parameters of object_scanner: what they mean, their ranges, and the options that they make."""

from typing import Any

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.nodes.parameters import Parameter
from poise.robot import Mounting
from poise.scanning import MOST_FRAMES, STATIONARY_FRAMES, ScanOptions, SessionOptions, SweepOptions

_REFINE = ("auto", "always", "never")
_NOWHERE, _UNKNOWN = [float("nan")] * 3, [float("nan")] * 7

SCANNER_PARAMETERS = (
    Parameter("object_id", "scanned_object", "id and frame of the object when the goal gives none"),
    Parameter("max_frames", MOST_FRAMES, "frames of a scan, at the most", (1, 600)),
    Parameter("frame_period", 0.2, "s between frames, at the least", (0.0, 10.0)),
    Parameter("duration", 60.0, "s after which a scan goes on with the frames it has", (0.1, 3600.0)),
    Parameter("patience", 5.0, "s without a frame after which it does", (0.1, 600.0)),
    Parameter("best_effort", False, "take images from a best-effort publisher too (some may be lost)"),
    Parameter("depth_unit", 0.001, "m, of integer depth images", (1e-6, 1.0)),
    Parameter("camera_delay", 0.0, "s that the stamps of images are late against those of joint_states", (-1.0, 1.0)),
    Parameter("hand_frame", "ft_sensor", "link of the robot for hand_eye, and for the joints that `sweep` moves"),
    Parameter(
        "hand_eye",
        _UNKNOWN,
        "the camera's optical frame in hand_frame: x y z m, quaternion x y z w; NaN: robot_description or tf_static",
    ),
    Parameter("sweep", "", "trajectory file (YAML, CSV) for joint_trajectory; empty: another program moves the arm"),
    Parameter("start_tolerance", 0.05, "rad that the arm may be off where the sweep begins", (0.0, 3.2)),
    Parameter("near", _NOWHERE, "m in the robot's base: of several objects, the one nearest to it; NaN: in the middle"),
    Parameter("voxel", 0.0015, "m, spacing of the points", (2e-4, 0.05)),
    Parameter("farthest", 1.2, "m from the camera up to which it is looked at", (0.1, 5.0)),
    Parameter("refine", "auto", "poses by ICP: when views disagree (auto), always or never", _REFINE),
    Parameter("complete", True, "fill what no view saw, down to the table"),
    Parameter(
        "independent_parts", True, "at most four parts, which a sensor at rest can distinguish; false: all of them"
    ),
)


def session_options(values: dict[str, Any], request: Any) -> SessionOptions:
    """When frames are taken."""
    frames = int(request.max_frames) or (STATIONARY_FRAMES if request.stationary else values["max_frames"])
    period = 0.0 if request.stationary else values["frame_period"]
    return SessionOptions(frames, period, values["duration"], values["patience"])


def sweep_options(values: dict[str, Any]) -> SweepOptions:
    """How frames get their poses.

    Raises:
        InputError: BAD_INPUT for a hand-eye transform that is none.
    """
    given = None
    if not np.isnan(values["hand_eye"]).all():
        given = Mounting.of_vector(values["hand_frame"], "camera", values["hand_eye"])
    return SweepOptions(hand_eye=given, unit=values["depth_unit"], delay=values["camera_delay"])


def scan_options(values: dict[str, Any]) -> ScanOptions:
    """How views become a cloud."""
    return ScanOptions(
        voxel=values["voxel"],
        farthest=values["farthest"],
        near=near_of(values),
        refine=values["refine"],
        complete=values["complete"],
    )


def near_of(values: dict[str, Any]) -> tuple[float, float, float] | None:
    """The point of the parameter `near`.

    Raises:
        InputError: BAD_INPUT.
    """
    point = np.array(values["near"], dtype=np.float64)
    if point.shape != (3,) or np.isinf(point).any() or np.isnan(point).any() != np.isnan(point).all():
        raise InputError(ErrorCode.BAD_INPUT, f"parameter near is {point.tolist()}: give x y z in m, or three NaN")
    return None if np.isnan(point).any() else (float(point[0]), float(point[1]), float(point[2]))
