"""A scan while it is taken: images, joint states and transforms come one by one, in any order; then all at once."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.recording import Image, JointStream
from poise.robot import Mounting
from poise.scanning.camera import Camera
from poise.scanning.frames import Frame, dropped_blind
from poise.scanning.imaging import frames_of_images
from poise.scanning.placing import Sweep, place
from poise.scanning.reading import FRAMES_TOGETHER, MOST_FRAMES, SweepOptions

_COLOURS_KEPT = 20
_MOST_STATES = 50_000
_LONG_GAP = 2.0
"""s without frames that are reported, when it is more than three periods."""
STATIONARY_FRAMES = 8
"""Of a camera that stands still: more only average its noise."""


@dataclass(frozen=True)
class SessionOptions:
    """When frames are taken, and when it is enough.

    Args:
        frames: how many.
        period: s between frames, at the least.
        duration: s after which it continues with the frames it has.
        patience: s without a (further) frame after which it does.
    """

    frames: int = MOST_FRAMES
    period: float = 0.2
    duration: float = 60.0
    patience: float = 5.0


class RobotLog:
    """What is heard of the robot: description, joint states, fixed transforms."""

    def __init__(self) -> None:
        self.description = ""
        self.fixed: dict[str, Mounting] = {}
        self._states: deque[tuple[int, dict[str, float]]] = deque(maxlen=_MOST_STATES)

    def add_joint_state(self, stamp: int, names: Sequence[str], position: Sequence[float]) -> None:
        """Take in a joint state; one without positions is left out."""
        if names and len(names) == len(position):
            if (
                self._states and stamp < self._states[-1][0] - 10**9
            ):  # a clock that was set back, a bag that started over
                self._states.clear()
            self._states.append((stamp, dict(zip(names, position, strict=True))))

    def copy(self) -> "RobotLog":
        """As it is now, for another thread."""
        other = RobotLog()
        other.description, other.fixed, other._states = self.description, dict(self.fixed), self._states.copy()
        return other

    @property
    def newest(self) -> int:
        """ns of the last joint state; 0 without any."""
        return self._states[-1][0] if self._states else 0

    def joints(self, names: tuple[str, ...]) -> JointStream:
        """The states of some joints, in the order of their stamps.

        Raises:
            InputError: TOPIC_MISSING without any joint states, JOINT_MISSING when none has these joints.
        """
        if not self._states:
            raise InputError(ErrorCode.TOPIC_MISSING, "scan: no joint_states came: start the arm's driver, or remap it")
        rows = sorted(((s, state) for s, state in self._states if all(n in state for n in names)), key=lambda r: r[0])
        if not rows:
            there = ", ".join(self._states[-1][1])
            raise InputError(ErrorCode.JOINT_MISSING, f"scan: joint_states lack {', '.join(names)}; they have {there}")
        position = np.array([[state[name] for name in names] for _, state in rows]).reshape(len(rows), len(names))
        unknown = np.full_like(position, np.nan)
        return JointStream(np.array([stamp for stamp, _ in rows]), names, position, unknown, unknown)


class ScanSession:
    """Frames of one scan.

    Args:
        options: when it is enough.
        begin: s on the caller's monotonic clock.
    """

    def __init__(self, options: SessionOptions, begin: float) -> None:
        self.options = options
        self._begin = self._last = begin
        self._camera: Camera | None = None
        self._lens: Camera | None = None
        self._depths: list[Image] = []
        self._clouds: list[Frame] = []
        self._colours: deque[Image] = deque(maxlen=_COLOURS_KEPT)
        self._paired: dict[int, Image] = {}
        self.problem: InputError | None = None
        """What was wrong with the last message that could not be used."""

    @property
    def count(self) -> int:
        """Frames so far."""
        return len(self._depths) + len(self._clouds)

    @property
    def progress(self) -> float:
        """0..1 of the frames wanted."""
        return min(self.count / self.options.frames, 1.0)

    @property
    def newest(self) -> int:
        """ns of the last frame; 0 without any."""
        depths, clouds = [image.stamp for image in self._depths], [frame.stamp for frame in self._clouds]
        return max(depths[-1:] + clouds[-1:], default=0)

    @property
    def full(self) -> bool:
        """Whether all frames are there."""
        return self.count >= self.options.frames

    @property
    def longest_gap(self) -> float:
        """s between two frames, at most; 0 with fewer than two."""
        stamps = sorted([image.stamp for image in self._depths] + [frame.stamp for frame in self._clouds])
        return max((after - before for before, after in pairwise(stamps)), default=0) * 1e-9

    def silent(self, now: float) -> float:
        """s since the last frame that was taken, or since the begin."""
        return now - self._last

    def set_camera(self, camera: Camera) -> None:
        """Take in the camera info."""
        self._camera = camera

    def set_colour_camera(self, camera: Camera) -> None:
        """Take in the camera info of the colour images, for those that are not aligned to the depth."""
        self._lens = camera

    def add_depth(self, image: Image, now: float) -> None:
        """Take in a depth image, unless it comes too soon after the last."""
        if self._wanted(image.stamp):
            self._depths.append(image)
            self._last = now
            self._pair(image.stamp)

    def add_cloud(self, frame: Frame, now: float) -> None:
        """Take in a cloud."""
        if self._wanted(frame.stamp):
            self._clouds.append(frame)
            self._last = now

    def add_colour(self, image: Image) -> None:
        """Take in a colour image; it may come before or after the depth it belongs to."""
        self._colours.append(image)
        for depth in self._depths[-_COLOURS_KEPT:]:
            self._pair(depth.stamp)

    def _wanted(self, stamp: int) -> bool:
        late = not self.count or abs(stamp - self.newest) >= (self.options.period - 1e-3) * 1e9
        return late and self.count < self.options.frames

    def _pair(self, stamp: int) -> None:
        near = min(self._colours, key=lambda image: abs(image.stamp - stamp), default=None)
        best = self._paired.get(stamp)
        if near is None or abs(near.stamp - stamp) > FRAMES_TOGETHER * 1e9:
            return
        if best is None or abs(near.stamp - stamp) < abs(best.stamp - stamp):
            self._paired[stamp] = near

    def enough(self, now: float) -> bool:
        """Whether to go on: all frames are there, time is up, or no more come."""
        return self.full or now - self._begin > self.options.duration or self.silent(now) > self.options.patience

    def sweep(self, robot: RobotLog, options: SweepOptions) -> Sweep:
        """The views that were taken.

        Raises:
            InputError: TOPIC_MISSING or ROBOT_DESCRIPTION_MISSING, naming what did not come; as `place`.
        """
        if not self.count:
            raise self.problem or InputError(
                ErrorCode.TOPIC_MISSING,
                f"scan: no depth image and no cloud came within {self.options.patience:g} s: start the camera's driver"
                " with align_depth, or remap its topics",
            )
        if self._depths and self._camera is None:
            raise self.problem or InputError(
                ErrorCode.TOPIC_MISSING, "scan: depth came, but no camera_info: remap the one of the aligned depth"
            )
        if not robot.description:
            raise InputError(
                ErrorCode.ROBOT_DESCRIPTION_MISSING, "scan: no robot_description came: start robot_state_publisher"
            )
        fixed = list(robot.fixed.values())

        def placed(frames: Sequence[Frame]) -> Sweep:
            return place(frames, robot.description, fixed, robot.joints, options.hand_eye, options.delay)

        if self._depths and self._camera is not None:
            frames, notes = frames_of_images(
                self._depths,
                self._camera,
                self._paired,
                self._lens,
                fixed,
                options.unit,
                lambda some: placed(some).views,
            )
        else:
            frames, notes = dropped_blind(self._clouds)
        found = placed(frames)
        notes += found.notes
        if (gap := self.longest_gap) > max(_LONG_GAP, 3 * self.options.period):
            notes.append(f"the camera sent no frame for {gap:.1f} s: what was seen only then is missing")
        if self.problem:
            notes.append(f"some messages could not be used: {self.problem.message}")
        return replace(found, notes=tuple(notes))
