"""Depth and colour images into frames, the same for a bag and for a live camera: units, covered lenses, colours."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.recording import Image
from poise.robot import FrameTree, Mounting
from poise.scanning.camera import Camera
from poise.scanning.frames import MILLIMETRE, Frame, View, depth_in_metres, dropped_blind
from poise.scanning.painting import painted
from poise.scanning.units import guessed_unit

_INTEGERS = ("16UC1", "mono16")
_ASKED = 12
"""Images that show the unit."""
Placed = Callable[[Sequence[Frame]], Sequence[View]]
"""Gives frames their poses; those without one are left out."""


def frames_of_images(
    images: Sequence[Image],
    camera: Camera,
    colours: Mapping[int, Image],
    lens: Camera | None,
    fixed: Sequence[Mounting],
    unit: float | None,
    placed: Placed,
) -> tuple[list[Frame], list[str]]:
    """The frames, without those of a covered lens; and what to say of them.

    Args:
        images: depth.
        camera: of the depth.
        colours: by the stamps of the depth that they belong to.
        lens: the camera of the colours; None: not known.
        fixed: transforms, of which some may connect both cameras.
        unit: m, of integer depth; None: millimetres, or what shows a table.
        placed: gives the poses that show the unit.

    Raises:
        InputError: TYPE_MISMATCH for depth of another size than its camera; as `depth_in_metres` and `guessed_unit`.
    """
    notes: list[str] = []
    if unit is None and images and images[0].encoding in _INTEGERS:
        unit, notes = _unit(images, camera, placed)
    frames, blind = dropped_blind([frame_of(image, camera, unit or MILLIMETRE) for image in images])
    paint = _Paint(colours, lens, fixed)
    coloured = [paint.on(frame) for frame in frames]
    return coloured, [*notes, *blind, *paint.notes]


def frame_of(depth: Image, camera: Camera, unit: float = MILLIMETRE) -> Frame:
    """A depth image in metres, without colours.

    Raises:
        InputError: TYPE_MISMATCH when depth and camera are not of one size.
    """
    height, width = depth.pixels.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise InputError(
            ErrorCode.TYPE_MISMATCH,
            f"scan: depth has {width} x {height} pixels, its camera_info {camera.width} x {camera.height}; take the"
            " camera_info of the same image",
        )
    return Frame(depth.stamp, depth.frame_id, camera, depth_in_metres(depth.pixels, depth.encoding, unit=unit))


def _unit(images: Sequence[Image], camera: Camera, placed: Placed) -> tuple[float, list[str]]:
    """m, of integer depth, and what to say of it."""
    few = [images[i] for i in np.unique(np.linspace(0, len(images) - 1, _ASKED).round().astype(int))]
    known = np.concatenate([image.pixels[::8, ::8][image.pixels[::8, ::8] > 0].astype(np.float64) for image in few])
    if not len(known):
        return MILLIMETRE, []
    by_stamp = {image.stamp: image for image in few}
    views = placed([frame_of(image, camera) for image in few])

    def views_in(unit: float) -> list[View]:
        return [replace(view, frame=frame_of(by_stamp[view.frame.stamp], camera, unit)) for view in views]

    unit, note = guessed_unit(float(np.median(known)), views_in, np.array([0.0, 0.0, 1.0]))
    return unit, [note] if note else []


class _Paint:
    """The colours of frames: as they are where they are aligned, else looked up; left out where that is not possible.

    Args:
        images: by the stamps of the depth that they belong to.
        lens: their camera; None: not known.
        fixed: transforms, of which some may connect both cameras.
    """

    def __init__(self, images: Mapping[int, Image], lens: Camera | None, fixed: Sequence[Mounting]) -> None:
        self.notes: list[str] = []
        self._images, self._lens, self._fixed = images, lens, fixed
        self._poses: dict[tuple[str, str], Pose | None] = {}

    def on(self, frame: Frame) -> Frame:
        """The frame with its colours."""
        image = self._images.get(frame.stamp)
        if image is None:
            return frame
        same_size = image.pixels.shape[:2] == frame.depth.shape
        if same_size and image.frame_id == frame.frame_id:
            return replace(frame, colours=image.pixels)
        pose, lens = self._pose(image.frame_id, frame.frame_id), self._lens
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
            for mounting in self._fixed:
                tree.add_mounting(mounting)
            same = Pose.identity() if colour_frame == depth_frame else None
            self._poses[key] = same or tree.pose(depth_frame, colour_frame)
        return self._poses[key]
