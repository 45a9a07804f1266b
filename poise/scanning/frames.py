"""What a camera saw at one moment: a depth image, its colours, where the camera was. Validated on input."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.scanning.camera import Camera, rotated
from poise.types import Array, Single

MILLIMETRE = 1e-3
NEAREST, FARTHEST = 0.05, 5.0
"""m between which depth is believed."""
_BLIND = 0.25
"""Of the depth that the middle one of the frames has: a frame with less was taken by a covered camera."""
SANE = 20.0
"""m: a typical depth beyond this is millimetres in a float image."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One RGB-D image.

    Args:
        stamp: ns.
        frame_id: the camera's optical frame.
        camera: of depth and colour, which are aligned.
        depth: (H, W) float32 m along the optical axis; 0 where nothing is known.
        colours: (H, W, 3) uint8 RGB, or None.
    """

    stamp: int
    frame_id: str
    camera: Camera
    depth: Single
    colours: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class View:
    """A frame and where its camera was.

    Args:
        frame: what was seen.
        rotation_world_camera: (3, 3).
        translation_world_camera: (3,) m.
        sure: whether the pose is the kinematics' own; False where it was interpolated over a gap.
    """

    frame: Frame
    rotation_world_camera: Array
    translation_world_camera: Array
    sure: bool = True

    def moved(self, rotation: Array, translation: Array) -> "View":
        """The view after a motion of the camera in the world: x -> rotation x + translation."""
        return replace(
            self,
            rotation_world_camera=rotation @ self.rotation_world_camera,
            translation_world_camera=rotation @ self.translation_world_camera + translation,
        )

    def in_camera(self, points: NDArray[np.floating]) -> Single:
        """(N, 3) points of the world in the optical frame, m."""
        offset = (points - self.translation_world_camera).astype(np.float32)
        return np.asarray(rotated(offset, self.rotation_world_camera.T))


def dropped_blind(frames: Sequence[Frame]) -> tuple[list[Frame], list[str]]:
    """Frames without those in which the camera was covered or gave no depth, and a sentence about these."""
    shares = np.array([np.mean(frame.depth > 0) for frame in frames])
    blind = shares < _BLIND * np.median(shares) if len(shares) else np.zeros(0, bool)
    kept = [frame for frame, gone in zip(frames, blind, strict=True) if not gone]
    if not blind.any():
        return kept, []
    note = f"{blind.sum()} of {len(frames)} frames have hardly any depth (was the lens covered?) and were left out"
    return kept, [note]


def depth_in_metres(image: ArrayLike, encoding: str, name: str = "depth image", unit: float = MILLIMETRE) -> Single:
    """Depth as it comes in sensor_msgs/Image, in m; what is not finite or not believable is 0.

    Args:
        image: (H, W).
        encoding: 16UC1 or mono16 (mm, REP-118), 32FC1 (m).
        name: of the image, for errors.
        unit: m, of integers.

    Raises:
        InputError: UNSUPPORTED for another encoding, BAD_INPUT for floats that are millimetres.
    """
    values = np.asarray(image)
    if encoding in ("16UC1", "mono16"):
        depth = values.astype(np.float32) * np.float32(unit)
    elif encoding == "32FC1":
        depth = np.nan_to_num(values.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)
        known = depth[depth > 0]
        if known.size and float(np.median(known[:: max(known.size // 1000, 1)])) > SANE:
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"{name}: 32FC1 with {float(np.median(known)):.0f} as its typical depth: these are millimetres; REP-118"
                " wants metres, or 16UC1 for millimetres",
            )
    else:
        raise InputError(
            ErrorCode.UNSUPPORTED,
            f"{name}: encoding {encoding!r} is not a depth encoding; give 16UC1 (mm) or 32FC1 (m)",
        )
    depth[(depth < NEAREST) | (depth > FARTHEST)] = 0.0
    return depth
