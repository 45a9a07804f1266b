"""The tree of coordinate frames: fixed and moving transforms, interpolated, between any two frames."""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, are_rotations
from poise.recording import PoseStream, interpolate, interpolate_rotations
from poise.robot.stamped_buffer import StampedBuffer, went_back
from poise.types import Mask, Stamps


@dataclass(frozen=True, eq=False)
class Mounting(Pose):
    """The fixed pose of a child frame in its parent, with their names."""

    parent: str
    child: str

    @classmethod
    def of_vector(cls, parent: str, child: str, vector: ArrayLike) -> "Mounting":
        """From x y z (m) and a unit quaternion x y z w.

        Raises:
            InputError: BAD_INPUT when that is not a pose.
        """
        values = np.asarray(vector, dtype=np.float64)
        if values.shape != (7,) or not np.isfinite(values).all() or abs(np.linalg.norm(values[3:]) - 1) > 1e-2:
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"transform {parent} -> {child}: {values.tolist()} is not a pose; give x y z in m and a unit quaternion"
                " x y z w",
            )
        pose = Pose.from_vector(values)
        return cls(pose.rotation, pose.translation, parent, child)


class FrameTree:
    """Transforms of child frames in their parents, as tf, tf_static or a URDF give them.

    The newest transform of each frame is always known. Earlier ones are kept until `forget_before`, so that poses at
    earlier stamps can be interpolated.

    Args:
        one_parent: refuse a frame that changes its parent. Else the newest parent counts, as for an object that is
            handed over from a tray to a gripper.
        keep: remember moving transforms; else only the newest of each frame.
        max_gap: s between two samples of a transform across which it is not interpolated.
    """

    def __init__(self, *, one_parent: bool = True, keep: bool = True, max_gap: float = 0.2) -> None:
        self.max_gap = max_gap
        self.not_finite = 0
        """Transforms that are not a rigid motion, or not finite."""
        self.jumps = 0
        """How often the stamps went back by more than messages can be late."""
        self.has_positions = False
        """Some transform has a translation; without any, only attitudes are known."""
        self._one_parent, self._keep = one_parent, keep
        self._parent: dict[str, str] = {}
        self._newest: dict[str, Pose] = {}
        self._fixed: set[str] = set()
        self._moving: dict[str, StampedBuffer] = {}

    def add(
        self,
        stamps: ArrayLike,
        parent: str,
        child: str,
        rotation: ArrayLike,
        translation: ArrayLike,
        *,
        fixed: bool = False,
    ) -> bool:
        """Add transforms, x_parent = rotation @ x_child + translation; invalid ones are counted and left out.

        Args:
            stamps: (N,) int64 ns.
            parent, child: frames.
            rotation: (N, 3, 3).
            translation: (N, 3) m.
            fixed: they come from tf_static or do not change; the last one holds for all times.

        Returns:
            Whether any of them is used.

        Raises:
            InputError: FRAME_UNKNOWN when a frame changes its parent and must not.
        """
        times, turns = np.asarray(stamps, dtype=np.int64), np.asarray(rotation, dtype=np.float64)
        shifts = np.asarray(translation, dtype=np.float64)
        good = are_rotations(turns) & np.isfinite(shifts).all(axis=1)
        self.not_finite += int(np.count_nonzero(~good))
        if not good.any():
            return False
        self._hang(child, parent)
        times, turns, shifts = times[good], turns[good], shifts[good]
        self.has_positions |= bool(np.any(shifts != 0))
        self._newest[child] = Pose(turns[-1], shifts[-1])
        if fixed:
            self._fixed.add(child)
            self._moving.pop(child, None)
            return True
        self._fixed.discard(child)
        buffer = self._moving.setdefault(child, StampedBuffer(12))
        if went_back(times, buffer.newest):
            self.jumps += 1
            self.clear()
        if not self._keep:
            buffer.clear()
        buffer.extend(times, np.hstack([turns.reshape(-1, 9), shifts]))
        return True

    def add_stream(self, stream: PoseStream) -> bool:
        """Add recorded transforms; a single one does not change.

        Raises:
            InputError: as `add`.
        """
        pose = stream.rotation_parent_child, stream.translation_parent_child
        return self.add(stream.stamps, stream.parent, stream.child, *pose, fixed=len(stream) == 1)

    def add_mounting(self, mounting: Mounting) -> bool:
        """Add a pose that does not change.

        Raises:
            InputError: as `add`.
        """
        pose = mounting.rotation[None], mounting.translation[None]
        return self.add([0], mounting.parent, mounting.child, *pose, fixed=True)

    @property
    def frames(self) -> tuple[str, ...]:
        """Every frame that has a parent."""
        return tuple(self._parent)

    def ancestors(self, frame: str, fixed_only: bool = False) -> dict[str, Pose]:
        """The newest pose of a frame in itself and in each of its ancestors, from the frame upwards.

        Args:
            frame: where to begin.
            fixed_only: end at the first transform that moves.
        """
        found = {frame: Pose.identity()}
        for child, parent in itertools.pairwise(self._upwards(frame, fixed_only)):
            found[parent] = self._newest[child] @ found[child]
        return found

    def pose(self, frame: str, reference: str, fixed_only: bool = False) -> Pose | None:
        """The newest pose of a frame in another, through their nearest common ancestor; None when nothing joins them.

        Args:
            frame, reference: any two frames.
            fixed_only: only transforms that do not move may join them.
        """
        of_frame, of_reference = self.ancestors(frame, fixed_only), self.ancestors(reference, fixed_only)
        common = next((name for name in of_reference if name in of_frame), None)
        return None if common is None else of_reference[common].inverse @ of_frame[common]

    def age(self, frame: str, reference: str, now: int) -> float:
        """s at `now`, ns, since the oldest of the newest moving transforms that join two frames; 0 without any."""
        up, down = self._upwards(frame), self._upwards(reference)
        joining = set(up) ^ set(down)  # without the common ancestors; the nearest of these moves both frames
        newest = [self._moving[child].newest for child in joining if child in self._moving]
        return max((1e-9 * (now - stamp) for stamp in newest if stamp is not None), default=0.0)

    def path(self, frame: str, reference: str | None) -> list[str]:
        """Frames below the reference (None: the topmost frame) down to `frame`; empty when it is not an ancestor."""
        names = self._upwards(frame)
        if reference is None:
            return names[-2::-1]
        return names[: names.index(reference)][::-1] if reference in names else []

    def poses(self, frame: str, reference: str, stamps: Stamps) -> tuple[Pose, Mask]:
        """Poses (N) of a frame in another at stamps (N,), interpolated, and where they are known.

        Raises:
            InputError: FRAME_UNKNOWN when nothing joins the frames.
        """
        up, down = self._upwards(frame), self._upwards(reference)
        common = next((name for name in down if name in up), None)
        if common is None:
            raise InputError(
                ErrorCode.FRAME_UNKNOWN, f"tf does not connect {frame} with {reference}: publish the missing transform"
            )
        of_frame, known = self._chained(up[: up.index(common)], stamps)
        of_reference, also = self._chained(down[: down.index(common)], stamps)
        return of_reference.inverse @ of_frame, known & also

    def newest(self, path: list[str]) -> int | None:
        """The stamp (ns) up to which all moving transforms of a path are known; None without any, or before that."""
        ends = [self._moving[child].newest for child in path if child in self._moving]
        known = [end for end in ends if end is not None]
        return min(known) if known and len(known) == len(ends) else None

    def stamps(self, path: list[str], begin: int, end: int) -> Stamps:
        """Stamps, begin <= stamp <= end, of the last moving transform of a path."""
        moving = [self._moving[child] for child in path if child in self._moving]
        return moving[-1].between(begin, end)[0] if moving else np.zeros(0, dtype=np.int64)

    def forget_before(self, stamp: int) -> None:
        """Drop older samples of moving transforms."""
        for buffer in self._moving.values():
            buffer.forget_before(stamp)

    def keep_last(self, seconds: float) -> None:
        """Of each moving transform, drop samples that are older than its newest by more."""
        for buffer in self._moving.values():
            if buffer.newest is not None:
                buffer.forget_before(buffer.newest - round(seconds * 1e9))

    def clear(self) -> None:
        """Drop all samples of moving transforms: time has jumped."""
        for buffer in self._moving.values():
            buffer.clear()

    def _upwards(self, frame: str, fixed_only: bool = False) -> list[str]:
        """A frame, its parent, and so on; a circle ends before it closes."""
        names = [frame]
        while frame in self._parent and self._parent[frame] not in names and (frame in self._fixed or not fixed_only):
            frame = self._parent[frame]
            names.append(frame)
        return names

    def top(self, frame: str) -> str:
        """The topmost ancestor of a frame, or the frame itself."""
        return self._upwards(frame)[-1]

    def _hang(self, child: str, parent: str) -> None:
        before = self._parent.setdefault(child, parent)
        if before == parent:
            return
        if self._one_parent:
            raise InputError(
                ErrorCode.FRAME_UNKNOWN,
                f"tf: frame {child} has the parent {before} and now {parent}: let only one of the publishers run",
            )
        self._parent[child] = parent
        self._moving.pop(child, None)

    def _chained(self, upwards: list[str], stamps: Stamps) -> tuple[Pose, Mask]:
        """Poses (N) of the first of these frames in the parent of the last one, and where they are known."""
        n = len(stamps)
        pose, known = Pose(np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))), np.ones(n, dtype=bool)
        options: dict[str, Any] = {"max_gap": self.max_gap}
        for child in upwards:
            step = self._newest[child]
            if child in self._moving:
                samples, rows = self._moving[child].stamps, self._moving[child].rows
                turns = interpolate_rotations(samples, rows[:, :9], stamps, **options)
                step = Pose(turns.values, interpolate(samples, rows[:, 9:], stamps, **options).values)
                known = known & turns.found
            pose = step @ pose
        return pose, known
