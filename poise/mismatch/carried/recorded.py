"""A recorded scene on a base that moves: how the base accelerates, and where the objects are on it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from poise.assembly import Assembly
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, nearest_rotation
from poise.recording import PoseStream, Recording
from poise.robot import FrameTree, frames_above, has_topic, usable_odometry
from poise.types import Array, Mask, Stamps

GRID_RATE = 100.0
"""Hz of the grid on which the motion of the base is evaluated."""
_WINDOW, _FEWEST, _ORDER = 0.16, 7, 3
"""s and samples of the shortest stretch that a cubic is fitted to, whose second derivative is the acceleration."""
_GAP = 0.5
"""s between transforms across which a pose is interpolated."""
_LEAST = 1.0
"""s of a recording."""
_FIRST = 0.4
"""s at the beginning that show where an object stands."""
_BLOCK = 1.0
"""s of the parts of a track whose noise is compared."""
_NORMAL = 1.4826
"""Standard deviation over median absolute deviation."""


@dataclass(frozen=True, eq=False)
class ObjectTrack:
    """One object on the base, in the scene's frame as the base carries it along.

    Args:
        seconds: (N,) since the recording begins.
        rotation, translation: (N, 3, 3), (N, 3) m.
        noise: m and rad, one sigma of a position along an axis and of an angle.
    """

    seconds: Array
    rotation: Array
    translation: Array
    noise: tuple[float, float]

    @property
    def first(self) -> slice:
        """The samples that show where the object stands."""
        return slice(0, max(int(np.searchsorted(self.seconds, self.seconds[0] + _FIRST)), 1))

    @cached_property
    def start(self) -> Pose:
        """Where it stands at first."""
        turn = nearest_rotation(self.rotation[self.first].sum(axis=0))
        return Pose(turn, np.median(self.translation[self.first], axis=0))

    @cached_property
    def moved(self) -> Array:
        """(N,) m from there."""
        return np.asarray(np.linalg.norm(self.translation - self.start.translation, axis=1))


@dataclass(frozen=True, eq=False)
class CarriedRecording:
    """What a recording shows of a scene on a base.

    Args:
        carrier, world: frames of the base, and of what is at rest.
        seconds: (T,) since it begins, evenly.
        acceleration: (T, 3) m/s2, in the scene's frame: a scene whose base accelerates by as much, level and without
            turning, feels the same. It contains how the base leans.
        noise: m/s2, one sigma of an entry of it.
        objects: tracks by the ids of the scene.
        missing: ids of movable objects without poses.
        notes: what was left out.
    """

    carrier: str
    world: str
    seconds: Array
    acceleration: Array
    noise: float
    objects: Mapping[str, ObjectTrack]
    missing: tuple[str, ...]
    notes: tuple[str, ...] = ()


def read_carried(recording: Recording, scene: Assembly, carrier: str = "") -> CarriedRecording:
    """Read the motion of the base and of the objects from tf; that of the base from odom, too.

    Args:
        recording: with the objects' ids as frames.
        scene: where the objects stand at first; its frame moves with the base.
        carrier: frame of the base; empty: that of a fixed object, if tf has one of its id.

    Raises:
        InputError: FRAME_UNKNOWN for frames that tf lacks, EMPTY for a recording that is too short.
    """
    pairs = recording.frame_parents()
    children, frames = {child for child, _ in pairs}, {name for pair in pairs for name in pair}
    fixed = [item.id for item in scene.objects if item.fixed]
    carrier = carrier or next((name for name in fixed if name in frames), "")
    movable = [item.id for item in scene.objects if not item.fixed]
    present = [name for name in movable if name in children]
    if not carrier or not present:
        wanted = f"a fixed object ({', '.join(fixed)}; or --carrier)" if not carrier else ", ".join(movable)
        raise InputError(
            ErrorCode.FRAME_UNKNOWN,
            f"{recording.path}: tf has no frame of {wanted}; it has {', '.join(sorted(frames)) or 'none'}: publish"
            " the pose of each object with its id in the scene as child frame",
        )
    tree, world = _tree(recording, carrier, present)
    place = next((item.pose for item in scene.objects if item.fixed and item.id == carrier), Pose.identity())
    stamps, spacing = _grid(tree, carrier, world, recording)
    pose, known = tree.poses(carrier, world, stamps)
    kept = _longest(known)
    notes = () if known.all() else (_left_out(1e-9 * (stamps - stamps[0]), kept, carrier),)
    stamps, pose = stamps[kept], Pose(pose.rotation[kept], pose.translation[kept])
    seconds = 1e-9 * (stamps - stamps[0])
    acceleration, noise = _felt(seconds, pose @ place.inverse, scene, spacing)
    found = {name: _track(tree, name, carrier, place, stamps) for name in present}
    tracks = {name: track for name, track in found.items() if track is not None}
    missing = tuple(name for name in movable if name not in tracks)
    return CarriedRecording(carrier, world, seconds, acceleration, noise, tracks, missing, notes)


def _tree(recording: Recording, carrier: str, objects: list[str]) -> tuple[FrameTree, str]:
    """All transforms from the objects and the base upwards; and the frame at rest, the topmost of the base."""
    tree = FrameTree(one_parent=False, max_gap=_GAP)
    streams: dict[str, PoseStream] = {}
    for name in (carrier, *objects):
        streams |= {one.child: one for one in frames_above(recording, name)}
    if not _moves(streams, carrier) and has_topic(recording, "odom"):
        odometry = usable_odometry(recording.odometry())[0]
        streams.setdefault(odometry.child, odometry)
    for one in streams.values():
        tree.add_stream(one)
    path = tree.path(carrier, None)
    if not path:
        raise InputError(
            ErrorCode.FRAME_UNKNOWN,
            f"{recording.path}: nothing says where {carrier} is in a frame at rest: record its tf, or odom",
        )
    return tree, streams[path[0]].parent


def _moves(streams: Mapping[str, PoseStream], frame: str) -> bool:
    """Whether some transform above a frame has several samples."""
    while frame in streams:
        if len(streams[frame].stamps) > 1:
            return True
        frame = streams[frame].parent
    return False


def _grid(tree: FrameTree, carrier: str, world: str, recording: Recording) -> tuple[Stamps, float]:
    """Even stamps (ns), and s between the recorded samples of the base's pose."""
    stamps = tree.stamps(tree.path(carrier, world), -(2**62), 2**62)
    if len(stamps) < 2 or stamps[-1] - stamps[0] < _LEAST * 1e9:
        raise InputError(
            ErrorCode.EMPTY,
            f"{recording.path}: the pose of {carrier} in {world} is recorded for less than {_LEAST:g} s",
        )
    grid = np.arange(stamps[0], stamps[-1], round(1e9 / GRID_RATE), dtype=np.int64)
    return grid, float(np.median(np.diff(stamps))) * 1e-9


def _longest(known: Mask) -> slice:
    """The longest stretch of samples that are all known."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(np.int8), [0]])))
    begins, ends = edges[::2], edges[1::2]
    best = int(np.argmax(ends - begins))
    return slice(int(begins[best]), int(ends[best]))


def _left_out(seconds: Array, kept: slice, carrier: str) -> str:
    return (
        f"the pose of {carrier} has gaps of over {_GAP:g} s: only {seconds[kept.start]:.1f} to"
        f" {seconds[kept.stop - 1]:.1f} s are used"
    )


def _felt(seconds: Array, pose: Pose, scene: Assembly, spacing: float) -> tuple[Array, float]:
    """(T, 3) m/s2, and one sigma: the acceleration of an upright scene that feels the same (see `CarriedRecording`).

    It is that of the middle of the objects, which a base that turns accelerates, too.
    """
    step, gravity = 1 / GRID_RATE, np.asarray(scene.gravity)
    middle = np.mean([item.com_in_world for item in scene.objects if not item.fixed], axis=0)
    window = 2 * int(np.ceil(max(_WINDOW, _FEWEST * spacing) / (2 * step))) + 1
    window = min(window, len(seconds) - 1 + len(seconds) % 2)
    place = pose.rotation @ middle + pose.translation
    second = savgol_filter(place, window, _ORDER, deriv=2, delta=step, axis=0)
    left = place - savgol_filter(place, window, _ORDER, axis=0)
    noise = (
        _NORMAL
        * float(np.median(np.abs(left - np.median(left, axis=0))))
        / np.sqrt(max(1 - (_ORDER + 1) / window, 0.1))
    )
    samples = max(step, spacing) / step  # neighbours on the grid are interpolated between the same samples
    spread = noise * float(np.linalg.norm(savgol_coeffs(window, _ORDER, deriv=2, delta=step))) * np.sqrt(samples)
    down = np.array([0.0, 0.0, -np.linalg.norm(gravity)])
    felt = np.einsum("tji,tj->ti", pose.rotation, down - second)
    return np.asarray(gravity - felt), spread


def _track(tree: FrameTree, name: str, carrier: str, place: Pose, stamps: Stamps) -> ObjectTrack | None:
    """The track of an object while the base's motion is known; None for too few poses."""
    own = tree.stamps(tree.path(name, None), int(stamps[0]), int(stamps[-1]))
    moving = own if len(own) > 1 else stamps
    pose, known = tree.poses(name, carrier, moving)
    if np.count_nonzero(known) < _FEWEST:
        return None
    in_scene = place @ Pose(pose.rotation[known], pose.translation[known])
    seconds = 1e-9 * (moving[known] - stamps[0])
    turn = np.einsum("tji,tjk->tik", in_scene.rotation[:-1], in_scene.rotation[1:])
    angle = np.sqrt(np.maximum(3 - np.trace(turn, axis1=1, axis2=2), 0))  # |rotation vector| for small angles
    steps = np.abs(np.diff(in_scene.translation, axis=0))
    noise = _NORMAL * _quiet(steps, seconds) / np.sqrt(2), _quiet(angle, seconds) / np.sqrt(2) / 1.54
    return ObjectTrack(seconds, in_scene.rotation, in_scene.translation, noise)


def _quiet(steps: Array, seconds: Array) -> float:
    """The median step in the quieter parts of a track: an object that fell rolls on for the rest of it."""
    edges = np.searchsorted(seconds, np.arange(seconds[0], seconds[-1], _BLOCK))
    blocks = [block for block in np.split(steps, edges[1:]) if len(block) >= _FEWEST]
    return float(np.quantile([np.median(block) for block in blocks or [steps]], 0.3))
