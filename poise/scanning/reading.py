"""A recorded sweep: the camera's frames out of a bag, and where it was."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.recording import Image, JointStream, PoseStream, Recording, image_of, messages_of, stamp_of, stamps_of
from poise.robot import Mounting, frames_above, has_topic, is_constant
from poise.scanning.camera import Camera
from poise.scanning.cloud_frames import frame_of_cloud
from poise.scanning.frames import Frame, dropped_blind
from poise.scanning.imaging import frames_of_images
from poise.scanning.placing import Sweep, place, place_by_tf
from poise.scanning.topics import find_topics
from poise.types import Progress

MOST_FRAMES = 127
"""As many as the thesis' scan had (section 3.2.4)."""
FRAMES_TOGETHER = 0.04
"""s between a depth image and the colours that belong to it."""
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
    lens = camera_of(next(messages_of(recording, topics.colour_info))) if topics.colour_info else None
    colours, unread = _readable_colours(recording, topics.colour, chosen)
    fixed = fixed_transforms(recording)
    frames, notes = frames_of_images(
        images, camera, colours, lens, fixed, options.unit, lambda some: _placed(recording, some, options).views
    )
    return _with(_placed(recording, frames, options), unread + notes)


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


def camera_of(message: Any) -> Camera:
    """From the fields of sensor_msgs/CameraInfo."""
    return Camera.from_info(message.width, message.height, message.k, str(message.distortion_model), message.d)


def _readable_colours(
    recording: Recording, topic: str, chosen: NDArray[np.int64]
) -> tuple[dict[int, Image], list[str]]:
    """The colours of some stamps of depth; none, with a note, where their encoding is not read: depth is enough."""
    try:
        return _colours(recording, topic, chosen), []
    except InputError as error:
        if error.code is not ErrorCode.UNSUPPORTED:
            raise
        return {}, [f"colours were left out: {error.message}; record them as rgb8 or bgr8, raw or compressed"]


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
