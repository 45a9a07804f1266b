"""The views of a board in a recording: its corners, the joints at that moment, and the link with the camera."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from poise.calibration.boards import Detect
from poise.calibration.sightings import LEAST_CORNERS, Sighting
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.recording import IMAGE, INFO, JointStream, Recording, image_of, interpolate, messages_of
from poise.robot import RobotModel, frame_poses, parse_urdf
from poise.scanning import Camera, camera_of, fixed_transforms, hand_eye_of
from poise.types import Array

_GAP, _HALF = 0.1, 0.02
"""s between joint states that are interpolated, and to either side of an image for the velocity."""


@dataclass(frozen=True)
class LinkKinematics:
    """Where a link of a robot is.

    Args:
        model: as far as the link.
        link: its name.
    """

    model: RobotModel
    link: str

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(J)."""
        return self.model.joint_names

    def poses(self, position: Array) -> Pose:
        """(V) poses in the base, of (V, J) joint positions."""
        return Pose(*frame_poses(self.model, position, self.link))


@dataclass(frozen=True, eq=False)
class RecordedViews:
    """What a recording has for a calibration.

    Args:
        kinematics: of the link that carries the camera.
        frame: the camera's optical frame.
        camera: intrinsics.
        sightings: of the board, in order.
        images: how many there were.
    """

    kinematics: LinkKinematics
    frame: str
    camera: Camera
    sightings: tuple[Sighting, ...]
    images: int


def recorded_views(
    recording: Recording,
    detect: Detect,
    link: str = "",
    description: str | None = None,
    topic: str = "",
    progress: Callable[[float], None] = lambda share: None,
) -> RecordedViews:
    """Find the board in the images of a recording.

    Args:
        recording: with images, camera_info, joint_states and robot_description.
        detect: of the board.
        link: that carries the camera; empty: the one that tf_static or robot_description connect it to.
        description: URDF; None: the recording's.
        topic: of the images; empty: the one with colours.
        progress: called with the share that is done.

    Raises:
        InputError: TOPIC_MISSING, FRAME_UNKNOWN, JOINT_MISSING, EMPTY when images and joint states do not overlap.
    """
    images, info = _topics(recording, topic)
    camera = camera_of(next(messages_of(recording, info)))
    text = recording.robot_description() if description is None else description
    count, found, frame = recording.counts[images], list[tuple[int, Array, Array]](), ""
    for number, message in enumerate(messages_of(recording, images)):
        image = image_of(message, images)
        corners, pixels = detect(image.pixels)
        frame = image.frame_id
        if len(corners) >= LEAST_CORNERS:
            found.append((image.stamp, corners, pixels))
        progress((number + 1) / count)
    if link and link not in parse_urdf(text).links:
        raise InputError(ErrorCode.FRAME_UNKNOWN, f"calibrate: robot_description has no link {link!r}; give --link")
    carrier = link or hand_eye_of(text, frame, fixed_transforms(recording)).parent
    model = RobotModel.from_urdf(text, carrier)
    joints = recording.joint_states("joint_states", model.joint_names)
    sightings = _timed(found, joints, model)
    if found and not sightings:
        raise InputError(
            ErrorCode.EMPTY, "calibrate: joint_states and images do not overlap in time: record them with one clock"
        )
    return RecordedViews(LinkKinematics(model, carrier), frame, camera, tuple(sightings), count)


def _timed(found: Sequence[tuple[int, Array, Array]], joints: JointStream, model: RobotModel) -> list[Sighting]:
    """With the joints at the stamps; images without joint states around them are left out."""
    (position,) = model.order(joints.names, joints.position)
    stamps = np.array([stamp for stamp, _, _ in found], dtype=np.int64)
    half = round(_HALF * 1e9)
    at = {shift: interpolate(joints.stamps, position, stamps + shift, max_gap=_GAP) for shift in (-half, 0, half)}
    known = at[-half].found & at[0].found & at[half].found
    velocity = (at[half].values - at[-half].values) / (2 * _HALF)
    return [
        Sighting(stamp, at[0].values[row], velocity[row], corners, pixels)
        for row, (stamp, corners, pixels) in enumerate(found)
        if known[row]
    ]


def _topics(recording: Recording, wanted: str) -> tuple[str, str]:
    """The topics of images and of their camera_info."""
    images = [name for name, kind in recording.topics.items() if kind == IMAGE and recording.counts[name]]
    if wanted:
        images = [recording.topic(wanted, IMAGE).name]
    shown = {name: str(next(messages_of(recording, name)).encoding) for name in images}
    coloured = [name for name in images if not shown[name].startswith(("16UC1", "32FC1"))]
    infos = [name for name, kind in recording.topics.items() if kind == INFO and recording.counts[name]]
    if not coloured or not infos:
        missing = "image with colours or grey values" if not coloured else "camera_info"
        raise InputError(
            ErrorCode.TOPIC_MISSING,
            f"{recording.path} has no {missing}: record the camera's image, its camera_info, joint_states and"
            f" robot_description; it has {', '.join(recording.topics)}",
        )
    image = max(coloured, key=lambda name: "color" in name)
    folder = image.rpartition("/")[0]
    return image, next((name for name in infos if name.rpartition("/")[0] == folder), infos[0])
