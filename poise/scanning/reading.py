"""A recorded sweep: the camera's frames out of a bag, and where it was."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.recording import (
    CLOUD,
    IMAGE,
    INFO,
    Image,
    JointStream,
    Recording,
    image_of,
    messages_of,
    stamp_of,
    stamps_of,
)
from poise.robot import Mounting, RobotModel
from poise.scanning.camera import Camera
from poise.scanning.cloud_frames import frame_of_cloud
from poise.scanning.frames import MILLIMETRE, Frame, View, depth_in_metres
from poise.scanning.poses import CameraPoses, camera_poses, hand_eye_of

MOST_FRAMES = 127
"""As many as the thesis' scan had (section 3.2.4)."""
FRAMES_TOGETHER = 0.04
"""s between a depth image and the colours that belong to it."""
_DEPTHS = ("16UC1", "mono16", "32FC1")


@dataclass(frozen=True)
class SweepOptions:
    """Where in a bag the scan is.

    Args:
        depth: topic of a depth image or a PointCloud2; empty: found by its type.
        colour, info: topics; empty: found.
        description: URDF; None: the bag's.
        hand_eye: the camera's optical frame in a link of the robot; None: from robot_description and tf_static.
        frames: the most that are used, evenly over the sweep.
        unit: m, of integer depth.
        delay: s that the images' stamps are late.
    """

    depth: str = ""
    colour: str = ""
    info: str = ""
    description: str | None = None
    hand_eye: Mounting | None = None
    frames: int = MOST_FRAMES
    unit: float = MILLIMETRE
    delay: float = 0.0


@dataclass(frozen=True, eq=False)
class Sweep:
    """Views of a scene.

    Args:
        views: with their poses in the robot's base.
        base: the name of that frame.
        notes: what was left out, one sentence each.
    """

    views: list[View]
    base: str
    notes: tuple[str, ...] = ()


def read_sweep(
    recording: Recording, options: SweepOptions, progress: Callable[[float], None] = lambda share: None
) -> Sweep:
    """Read the frames of a bag and the camera's poses.

    Raises:
        InputError: TOPIC_MISSING, TYPE_MISMATCH, ROBOT_DESCRIPTION_MISSING, ROBOT_DESCRIPTION_INVALID, FRAME_UNKNOWN,
            JOINT_MISSING, UNSUPPORTED, BAD_INPUT, EMPTY: what the bag lacks, and how to fix it.
    """
    topics = find_topics(recording, options)
    stamps = stamps_of(recording, topics["depth"])
    chosen = stamps if len(stamps) <= options.frames else stamps[_evenly(len(stamps), options.frames)]
    found = _read_frames(recording, topics, chosen, options.unit, progress)
    description = recording.robot_description() if options.description is None else options.description
    return place(found, description, fixed_transforms(recording), lambda names: _joints(recording, names), options)


def place(
    frames: Sequence[Frame],
    description: str,
    fixed: Sequence[Mounting],
    joints_of: Callable[[tuple[str, ...]], JointStream],
    options: SweepOptions,
) -> Sweep:
    """Give frames their poses; those without are left out and reported.

    Args:
        frames: of one camera.
        description: URDF.
        fixed: from tf_static.
        joints_of: the states of joints by their names.
        options: `hand_eye` and `delay` count here.

    Raises:
        InputError: as `hand_eye_of` and `camera_poses`; EMPTY when no frame has a pose; FRAME_UNKNOWN for frames of
            several cameras.
    """
    names = sorted({frame.frame_id for frame in frames})
    if len(names) != 1:
        raise InputError(
            ErrorCode.FRAME_UNKNOWN, f"scan: frames of {len(names)} cameras ({', '.join(names)}): choose one of them"
        )
    given = [] if options.hand_eye is None else [replace(options.hand_eye, child=names[0])]
    hand_eye = hand_eye_of(description, names[0], [*fixed, *given])
    model = RobotModel.from_urdf(description, hand_eye.parent)
    joints = joints_of(model.joint_names)
    stamps = np.array([frame.stamp for frame in frames])
    poses = camera_poses(model, joints, hand_eye, stamps, options.delay)
    if not poses.known.any():
        raise InputError(
            ErrorCode.EMPTY,
            f"scan: joint_states ({_span(joints.stamps)}) and images ({_span(stamps)}) do not overlap in time: record"
            " them together, with one clock",
        )
    notes = []
    if not poses.known.all():
        lost = int(np.sum(~poses.known))
        notes.append(f"{lost} of {len(frames)} frames have no joint states around them and were left out")
    guessed = int(np.sum(poses.known & ~poses.sure))
    if guessed:
        notes.append(f"{guessed} frames fall into gaps of joint_states; their poses were interpolated")
    return Sweep(views_of(frames, poses), model.base_frame, tuple(notes))


def views_of(frames: Sequence[Frame], poses: CameraPoses) -> list[View]:
    """Frames with their poses, where there is one."""
    return [
        View(frame, poses.rotation[i], poses.translation[i], bool(poses.sure[i]))
        for i, frame in enumerate(frames)
        if poses.known[i]
    ]


def find_topics(recording: Recording, options: SweepOptions) -> dict[str, str]:
    """Which topics carry what: depth (or a cloud), camera info, and colours ("" without).

    Raises:
        InputError: TOPIC_MISSING, naming the topics of the bag.
    """
    if options.depth and recording.topic(options.depth).type == CLOUD:
        return {"kind": CLOUD, "depth": recording.topic(options.depth).name, "colour": "", "info": ""}
    images = [name for name, kind in recording.topics.items() if kind == IMAGE and recording.counts[name]]
    encodings = {name: str(next(messages_of(recording, name)).encoding) for name in images}
    depths = [name for name in images if encodings[name] in _DEPTHS]
    depth = recording.topic(options.depth, IMAGE).name if options.depth else _best(depths, ("aligned", "depth"))
    if not depth:
        clouds = [name for name, kind in recording.topics.items() if kind == CLOUD and recording.counts[name]]
        if clouds:
            return {"kind": CLOUD, "depth": _best(clouds, ("depth",)), "colour": "", "info": ""}
        there = ", ".join(f"{name} ({kind})" for name, kind in recording.topics.items())
        raise InputError(
            ErrorCode.TOPIC_MISSING,
            f"{recording.path} has no depth: record the aligned depth image with its camera_info, or a PointCloud2; it"
            f" has {there}",
        )
    colours = [name for name in images if name not in depths]
    colour = recording.topic(options.colour, IMAGE).name if options.colour else _best(colours, ("color", "rgb"))
    infos = [name for name, kind in recording.topics.items() if kind == INFO and recording.counts[name]]
    info = recording.topic(options.info, INFO).name if options.info else _nearest_name(infos, depth)
    if not info:
        raise InputError(
            ErrorCode.TOPIC_MISSING,
            f"{recording.path} has no camera_info, without which {depth} has no rays: record the camera_info of the"
            " aligned depth",
        )
    return {"kind": IMAGE, "depth": depth, "colour": colour, "info": info}


def _best(names: Sequence[str], words: Sequence[str]) -> str:
    """The name that holds most of these words; empty when there is none."""
    return max(names, key=lambda name: sum(word in name for word in words), default="")


def _nearest_name(infos: Sequence[str], depth: str) -> str:
    """The camera info in the folder of the depth image, else the one most like it."""
    folder = depth.rpartition("/")[0]
    inside = [name for name in infos if name.rpartition("/")[0] == folder]
    return inside[0] if inside else _best(infos, tuple(folder.split("/")))


def _read_frames(
    recording: Recording,
    topics: dict[str, str],
    chosen: NDArray[np.int64],
    unit: float,
    progress: Callable[[float], None],
) -> list[Frame]:
    """The depth images, or clouds, of some stamps."""
    wanted, frames = set(chosen.tolist()), []
    camera, colours = None, {}
    if topics["kind"] == IMAGE:
        camera = camera_of(next(messages_of(recording, topics["info"])))
        colours = _colours(recording, topics["colour"], chosen)
    for message in messages_of(recording, topics["depth"]):
        stamp = stamp_of(message)
        if stamp not in wanted:
            continue
        if camera is None:
            frames.append(frame_of_cloud(message, topics["depth"]))
        else:
            frames.append(frame_of(image_of(message, topics["depth"]), colours.get(stamp), camera, unit))
        progress(len(frames) / len(chosen))
    return frames


def camera_of(message: Any) -> Camera:
    """From the fields of sensor_msgs/CameraInfo."""
    return Camera.from_info(message.width, message.height, message.k, str(message.distortion_model), message.d)


def frame_of(depth: Image, colour: Image | None, camera: Camera, unit: float = MILLIMETRE) -> Frame:
    """A depth image with its colours.

    Raises:
        InputError: TYPE_MISMATCH when depth, colour and camera are not of one size.
    """
    height, width = depth.pixels.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise InputError(
            ErrorCode.TYPE_MISMATCH,
            f"scan: depth has {width} x {height} pixels, its camera_info {camera.width} x {camera.height}; take the"
            " camera_info of the aligned depth",
        )
    if colour is not None and colour.pixels.shape[:2] != (height, width):
        raise InputError(
            ErrorCode.TYPE_MISMATCH,
            f"scan: depth has {width} x {height} pixels, colour {colour.pixels.shape[1]} x {colour.pixels.shape[0]};"
            " take the depth that is aligned to the colour (align_depth.enable)",
        )
    metres = depth_in_metres(depth.pixels, depth.encoding, unit=unit)
    return Frame(depth.stamp, depth.frame_id, camera, metres, None if colour is None else colour.pixels)


def _colours(recording: Recording, topic: str, chosen: NDArray[np.int64]) -> dict[int, Image]:
    """The colour image that belongs to each stamp of depth."""
    if not topic:
        return {}
    stamps = stamps_of(recording, topic)
    wanted: dict[int, list[int]] = {}
    for stamp in chosen.tolist():
        nearest = int(stamps[np.argmin(np.abs(stamps - stamp))])
        if abs(nearest - stamp) < FRAMES_TOGETHER * 1e9:
            wanted.setdefault(nearest, []).append(stamp)
    found = {}
    for message in messages_of(recording, topic):
        stamp = stamp_of(message)
        if stamp in wanted:
            image = image_of(message, topic)
            found.update(dict.fromkeys(wanted[stamp], image))
    return found


def fixed_transforms(recording: Recording) -> list[Mounting]:
    """The transforms of tf_static."""
    names = [name for name in recording.topics if name.strip("/").rpartition("/")[2] == "tf_static"]
    found = []
    for name in names:
        for message in messages_of(recording, name):
            found += [transform_of(stamped) for stamped in message.transforms]
    return found


def transform_of(stamped: Any) -> Mounting:
    """From the fields of geometry_msgs/TransformStamped."""
    shift, turn = stamped.transform.translation, stamped.transform.rotation
    pose = [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z, turn.w]
    return Mounting.of_vector(str(stamped.header.frame_id), str(stamped.child_frame_id), pose)


def _joints(recording: Recording, names: tuple[str, ...]) -> JointStream:
    return recording.joint_states("joint_states", names)


def _evenly(count: int, wanted: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, count - 1, wanted).round().astype(np.int64))


def _span(stamps: NDArray[np.int64]) -> str:
    if not len(stamps):
        return "none"
    return f"{stamps.min() * 1e-9:.2f} to {stamps.max() * 1e-9:.2f} s"
