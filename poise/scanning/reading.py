"""A recorded sweep: the camera's frames out of a bag, and where it was."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.recording import Image, JointStream, PoseStream, Recording, image_of, messages_of, stamp_of, stamps_of
from poise.robot import FrameTree, Mounting, frames_above, has_topic, is_constant
from poise.scanning.camera import Camera
from poise.scanning.cloud_frames import frame_of_cloud
from poise.scanning.frames import MILLIMETRE, Frame, View, depth_in_metres, dropped_blind
from poise.scanning.painting import painted
from poise.scanning.placing import Sweep, place, place_by_tf
from poise.scanning.topics import CameraTopics, find_topics
from poise.scanning.units import guessed_unit
from poise.types import Progress

MOST_FRAMES = 127
"""As many as the thesis' scan had (section 3.2.4)."""
FRAMES_TOGETHER = 0.04
"""s between a depth image and the colours that belong to it."""
_INTEGERS = ("16UC1", "mono16")
_NO_JOINTS = (
    ErrorCode.TOPIC_MISSING, ErrorCode.ROBOT_DESCRIPTION_MISSING, ErrorCode.FRAME_UNKNOWN, ErrorCode.JOINT_MISSING,
)  # fmt: skip
PoseSource = Literal["auto", "joints", "tf"]


@dataclass(frozen=True)
class SweepOptions:
    """Where in a bag the scan is.

    Args:
        depth: topic of a depth image, raw or compressed, or a PointCloud2; empty: found by its type.
        colour, info: topics; empty: found.
        description: URDF; None: the bag's.
        hand_eye: the camera's optical frame in a link of the robot; None: from robot_description and tf_static.
        frames: the most that are used, evenly over the sweep.
        unit: m, of integer depth; None: millimetres, or what shows a table.
        delay: s that the images' stamps are late.
        poses: whether joint states or tf say where the camera was; `auto`: tf where joint states do not.
        base: frame of the answer, whose z points up, for poses by tf; empty: the topmost. A turntable's frame, for a
            camera that stands still.
    """

    depth: str = ""
    colour: str = ""
    info: str = ""
    description: str | None = None
    hand_eye: Mounting | None = None
    frames: int = MOST_FRAMES
    unit: float | None = None
    delay: float = 0.0
    poses: PoseSource = "auto"
    base: str = ""


def read_sweep(recording: Recording, options: SweepOptions, progress: Progress = lambda share: None) -> Sweep:
    """Read the frames of a bag and the camera's poses.

    Raises:
        InputError: TOPIC_MISSING, TYPE_MISMATCH, ROBOT_DESCRIPTION_MISSING, ROBOT_DESCRIPTION_INVALID, FRAME_UNKNOWN,
            JOINT_MISSING, UNSUPPORTED, BAD_INPUT, EMPTY: what the bag lacks, and how to fix it.
    """
    topics = find_topics(recording, options.depth, options.colour, options.info)
    stamps = stamps_of(recording, topics.depth)
    chosen = stamps if len(stamps) <= options.frames else stamps[_evenly(len(stamps), options.frames)]
    if topics.cloud:
        frames, blind = dropped_blind(_cloud_frames(recording, topics.depth, chosen, progress))
        return _with(_placed(recording, frames, options), blind)
    images = _images(recording, topics.depth, chosen, progress)
    camera = camera_of(next(messages_of(recording, topics.info)))
    paint = _Paint(recording, topics, chosen)
    unit: float = options.unit or MILLIMETRE
    notes: list[str] = []
    if options.unit is None and images and images[0].encoding in _INTEGERS:
        unit, notes = _unit(recording, images, camera, options)
    frames, blind = dropped_blind([frame_of(image, None, camera, unit) for image in images])
    sweep = _placed(recording, [paint.on(frame) for frame in frames], options)
    return _with(sweep, [*notes, *blind, *paint.notes])


def _with(sweep: Sweep, notes: list[str]) -> Sweep:
    return replace(sweep, notes=(*notes, *sweep.notes))


def _placed(recording: Recording, frames: Sequence[Frame], options: SweepOptions) -> Sweep:
    """Frames with their poses, by joint states, or by tf where these do not say them."""
    fixed = fixed_transforms(recording)
    if options.poses != "tf":
        try:
            description = recording.robot_description() if options.description is None else options.description

            def joints_of(names: tuple[str, ...]) -> JointStream:
                return recording.joint_states("joint_states", names)

            return place(frames, description, fixed, joints_of, options.hand_eye, options.delay)
        except InputError as error:
            if options.poses == "joints" or error.code not in _NO_JOINTS or not frames:
                raise
            by_joints = error
    given = [] if options.hand_eye is None else [replace(options.hand_eye, child=frames[0].frame_id)]
    chain = [one for name in (frames[0].frame_id, options.base) if name for one in frames_above(recording, name)]
    chain += [one for mounting in given for one in frames_above(recording, mounting.parent)]
    unique = {one.child: one for one in chain}
    if options.poses != "tf" and not (options.base or _moved(recording, list(unique.values()))):
        raise by_joints
    sweep = place_by_tf(frames, list(unique.values()), options.base, [*fixed, *given], options.delay)
    return _with(sweep, [f"the camera's poses are those of tf, in {sweep.base}, whose z is taken to point up"])


def _moved(recording: Recording, chain: Sequence[PoseStream]) -> bool:
    """Whether transforms say where the camera was: they move, or no robot moved it."""
    robot = has_topic(recording, "joint_states") or has_topic(recording, "robot_description")
    return any(not is_constant(one) for one in chain) or bool(chain and not robot)


def _unit(
    recording: Recording, images: Sequence[Image], camera: Camera, options: SweepOptions
) -> tuple[float, list[str]]:
    """m, of integer depth, and what to say of it."""
    few = [images[i] for i in _evenly(len(images), min(12, len(images)))]
    known = np.concatenate([image.pixels[::8, ::8][image.pixels[::8, ::8] > 0].astype(np.float64) for image in few])
    if not len(known):
        return MILLIMETRE, []

    by_stamp = {image.stamp: image for image in few}
    placed = _placed(recording, [frame_of(image, None, camera) for image in few], options).views

    def views_in(unit: float) -> list[View]:
        return [replace(view, frame=frame_of(by_stamp[view.frame.stamp], None, camera, unit)) for view in placed]

    unit, note = guessed_unit(float(np.median(known)), views_in, np.array([0.0, 0.0, 1.0]))
    return unit, [note] if note else []


def _images(recording: Recording, topic: str, chosen: NDArray[np.int64], progress: Progress) -> list[Image]:
    """The depth images of some stamps."""
    wanted, images = set(chosen.tolist()), list[Image]()
    for message in messages_of(recording, topic):
        if stamp_of(message) in wanted:
            images.append(image_of(message, topic))
            progress(len(images) / len(chosen))
    return images


def _cloud_frames(recording: Recording, topic: str, chosen: NDArray[np.int64], progress: Progress) -> list[Frame]:
    """The clouds of some stamps, as images."""
    wanted, frames = set(chosen.tolist()), list[Frame]()
    for message in messages_of(recording, topic):
        if stamp_of(message) in wanted:
            frames.append(frame_of_cloud(message, topic))
            progress(len(frames) / len(chosen))
    return frames


class _Paint:
    """The colours of frames: as they are where they are aligned, else looked up; left out where that is not possible.

    Args:
        recording, topics: where they are.
        chosen: (N,) ns, stamps of the depth.
    """

    def __init__(self, recording: Recording, topics: CameraTopics, chosen: NDArray[np.int64]) -> None:
        self.notes: list[str] = []
        self._recording, self._topics = recording, topics
        self._images = _colours(recording, topics.colour, chosen)
        self._lens: Camera | None = None
        self._poses: dict[tuple[str, str], Pose | None] = {}

    def on(self, frame: Frame) -> Frame:
        """The frame with its colours."""
        image = self._images.get(frame.stamp)
        if image is None:
            return frame
        same_size = image.pixels.shape[:2] == frame.depth.shape
        if same_size and image.frame_id == frame.frame_id:
            return replace(frame, colours=image.pixels)
        pose, lens = self._pose(image.frame_id, frame.frame_id), self._camera()
        if pose is not None and lens is not None and image.pixels.shape[:2] == (lens.height, lens.width):
            self._say("depth and colour are not aligned: each depth pixel was looked up in the colour image")
            return replace(frame, colours=painted(frame.depth, frame.camera, image.pixels, lens, pose))
        self._say(
            f"depth ({frame.camera.width} x {frame.camera.height}, {frame.frame_id}) and colour"
            f" ({image.pixels.shape[1]} x {image.pixels.shape[0]}, {image.frame_id}) are not aligned, and"
            f" {'tf_static does not connect them' if pose is None else 'the colour has no fitting camera_info'}: the"
            " colours were left out"
        )
        return frame

    def _say(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)

    def _pose(self, colour_frame: str, depth_frame: str) -> Pose | None:
        key = colour_frame, depth_frame
        if key not in self._poses:
            tree = FrameTree(one_parent=False, keep=False)
            for one in fixed_transforms(self._recording):
                tree.add([0], one.parent, one.child, one.rotation[None], one.translation[None], fixed=True)
            same = Pose.identity() if colour_frame == depth_frame else None
            self._poses[key] = same or tree.pose(depth_frame, colour_frame)
        return self._poses[key]

    def _camera(self) -> Camera | None:
        if self._lens is None and self._topics.colour_info:
            self._lens = camera_of(next(messages_of(self._recording, self._topics.colour_info)))
        return self._lens


def camera_of(message: Any) -> Camera:
    """From the fields of sensor_msgs/CameraInfo."""
    return Camera.from_info(message.width, message.height, message.k, str(message.distortion_model), message.d)


def frame_of(depth: Image, colour: Image | None, camera: Camera, unit: float = MILLIMETRE) -> Frame:
    """A depth image with its colours, if they are aligned to it.

    Raises:
        InputError: TYPE_MISMATCH when depth, colour and camera are not of one size.
    """
    height, width = depth.pixels.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise InputError(
            ErrorCode.TYPE_MISMATCH,
            f"scan: depth has {width} x {height} pixels, its camera_info {camera.width} x {camera.height}; take the"
            " camera_info of the same image",
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


def _evenly(count: int, wanted: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, count - 1, wanted).round().astype(np.int64))
