"""The parameters of object_scanner: what they mean, their ranges, and the options that they make."""

from pathlib import Path
from typing import Any

import numpy as np
from sensor_msgs.msg import CompressedImage, Image

from poise.calibration import StoredCalibration, read_calibration
from poise.errors import ErrorCode, InputError
from poise.nodes.parameters import Parameter
from poise.nodes.readiness import READY_TIMEOUT
from poise.robot import Mounting
from poise.scanning import MOST_FRAMES, STATIONARY_FRAMES, ScanOptions, SessionOptions, SweepOptions
from poise.shape import SegmentationOptions

_REFINE = ("auto", "always", "never")
_TRANSPORTS, _DEPTH_TRANSPORTS = ("raw", "compressed"), ("raw", "compressedDepth")
_NOWHERE, _UNKNOWN = [float("nan")] * 3, [float("nan")] * 7

SCANNER_PARAMETERS = (
    Parameter("object_id", "scanned_object", "id and frame of the object when the goal gives none"),
    Parameter("max_frames", MOST_FRAMES, "largest number of frames of a scan", (1, 600), dynamic=True),
    Parameter("frame_period", 0.2, "least time between frames, s", (0.0, 10.0), dynamic=True),
    Parameter("duration", 60.0, "s after which a scan ends with the frames it has", (0.1, 3600.0), dynamic=True),
    Parameter("patience", 5.0, "s without a frame after which it ends", (0.1, 600.0), dynamic=True),
    Parameter("best_effort", False, "also accept images from a best-effort publisher (some may be lost)"),
    Parameter(
        "depth_unit",
        0.0,
        "unit of integer depth images, m; 0: millimetres, or the unit in which the views show one table",
        (0.0, 1.0),
    ),
    Parameter(
        "image_transport", "raw", "of the colour images: raw, or compressed (topic IMAGE/compressed)", _TRANSPORTS
    ),
    Parameter(
        "depth_image_transport",
        "raw",
        "of the depth: raw, or compressedDepth (topic IMAGE/compressedDepth, PNG or RVL)",
        _DEPTH_TRANSPORTS,
    ),
    Parameter("camera_delay", 0.0, "delay of the stamps of images relative to those of joint_states, s", (-1.0, 1.0)),
    Parameter("hand_frame", "ft_sensor", "link of the robot for hand_eye, and for the joints that `sweep` moves"),
    Parameter(
        "hand_eye",
        _UNKNOWN,
        "the camera's optical frame in hand_frame: x y z m, quaternion x y z w; NaN: robot_description or tf_static",
    ),
    Parameter("calibration", "", "file of poise calibrate: hand-eye transform, joint offsets, delay; empty: none"),
    Parameter(
        "sweep",
        "",
        "plan: planned for the region; a path: trajectory file (YAML, CSV); empty: another program moves the arm",
    ),
    Parameter(
        "support",
        "",
        "plan: fixed object of the assembly (a table) whose top is looked at; empty: the only one",
    ),
    Parameter("region_height", 0.2, "plan: m above the support that objects may be tall", (0.01, 1.0), dynamic=True),
    Parameter(
        "region",
        [float("nan")] * 6,
        "plan: x y z of the middle of its bottom and its size along x y z, m, in the assembly's frame; NaN: support",
    ),
    Parameter(
        "view_nearest", 0.3, "plan: least distance of the camera from what it looks at, m", (0.05, 5.0), dynamic=True
    ),
    Parameter("view_farthest", 0.5, "plan: largest one, m", (0.05, 5.0), dynamic=True),
    Parameter("plan_seconds", 20.0, "plan: time limit for planning paths of the arm, s", (0.1, 600.0), dynamic=True),
    Parameter("tcp_frame", "tcp", "plan: frame of robot_description between the finger tips"),
    Parameter("base", [0.0] * 4, "plan: pose of the robot's base in the assembly's frame without tf, x y z m, yaw rad"),
    Parameter("start_tolerance", 0.05, "largest distance of a joint from the start of the sweep, rad", (0.0, 3.2)),
    Parameter(
        "near",
        _NOWHERE,
        "of several objects, the one nearest to this point in the robot's base, m; NaN: to the middle",
    ),
    Parameter(
        "all_objects",
        False,
        "publish every object on the table (planned: of the region), ids ID, ID_2, ...; false: one",
        dynamic=True,
    ),
    READY_TIMEOUT,
    Parameter("voxel", 0.0015, "spacing of the points, m", (2e-4, 0.05), dynamic=True),
    Parameter("farthest", 1.2, "largest depth that is used, m", (0.1, 5.0), dynamic=True),
    Parameter("refine", "auto", "refine poses by ICP: if views disagree (auto), always or never", _REFINE),
    Parameter("complete", True, "fill the volume hidden from all views, down to the table", dynamic=True),
    Parameter("number_of_parts", 0, "cut into so many parts; 0: as found", (0, 100), dynamic=True),
    Parameter(
        "independent_parts",
        False,
        "at most four parts, which a sensor at rest can distinguish; false: all of them",
        dynamic=True,
    ),
)


def transported(topic: str, transport: str) -> tuple[type[Image | CompressedImage], str]:
    """Type and name of the topic on which image_transport publishes an image."""
    return (Image, topic) if transport == "raw" else (CompressedImage, f"{topic}/{transport}")


def session_options(values: dict[str, Any], request: Any, sweep: float = 0.0) -> SessionOptions:
    """When frames are taken; over all of a sweep of so many s."""
    frames = int(request.max_frames) or (STATIONARY_FRAMES if request.stationary else values["max_frames"])
    period = 0.0 if request.stationary else max(values["frame_period"], sweep / frames)
    return SessionOptions(frames, period, max(values["duration"], sweep + values["patience"]), values["patience"])


def stored_calibration(values: dict[str, Any]) -> StoredCalibration | None:
    """The file of the parameter `calibration`; None without one.

    Raises:
        InputError: FILE_UNREADABLE, BAD_INPUT.
    """
    return read_calibration(Path(values["calibration"])) if values["calibration"] else None


def given_eye(values: dict[str, Any]) -> Mounting | None:
    """The parameter `hand_eye`, else that of the file `calibration`.

    Raises:
        InputError: BAD_INPUT when it is no pose.
    """
    if np.isnan(values["hand_eye"]).all():
        stored = stored_calibration(values)
        return None if stored is None else stored.hand_eye
    return Mounting.of_vector(values["hand_frame"], "camera", values["hand_eye"])


def sweep_options(values: dict[str, Any]) -> SweepOptions:
    """How frames get their poses.

    Raises:
        InputError: BAD_INPUT for a hand-eye transform that is none.
    """
    stored = stored_calibration(values)
    delay = values["camera_delay"] + (0.0 if stored is None else stored.delay)
    return SweepOptions(hand_eye=given_eye(values), unit=values["depth_unit"] or None, delay=delay)


def scan_options(values: dict[str, Any]) -> ScanOptions:
    """How views become a cloud."""
    return ScanOptions(
        voxel=values["voxel"],
        farthest=values["farthest"],
        near=near_of(values),
        refine=values["refine"],
        complete=values["complete"],
    )


def segmentation_options(values: dict[str, Any]) -> SegmentationOptions:
    """How a cloud is cut into parts."""
    return SegmentationOptions(parts=values["number_of_parts"] or None)


def near_of(values: dict[str, Any]) -> tuple[float, float, float] | None:
    """The point of the parameter `near`.

    Raises:
        InputError: BAD_INPUT.
    """
    point = np.array(values["near"], dtype=np.float64)
    if point.shape != (3,) or np.isinf(point).any() or np.isnan(point).any() != np.isnan(point).all():
        raise InputError(ErrorCode.BAD_INPUT, f"parameter near is {point.tolist()}: give x y z in m, or three NaN")
    return None if np.isnan(point).any() else (float(point[0]), float(point[1]), float(point[2]))
