"""From views to the cloud of one object: seen, completed down to the table, and what is not trusted about it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.scanning.causes import likely_cause
from poise.scanning.completion import Completed, complete
from poise.scanning.depth_scale import depth_scale, rescaled
from poise.scanning.frames import View
from poise.scanning.fusion import Surface, coarse_points, fuse
from poise.scanning.judging import judge
from poise.scanning.moves import find_move
from poise.scanning.placing import Sweep
from poise.scanning.registration import MISFIT, refined, table_misfit
from poise.scanning.support import Footprint, Plane, find_plane, objects_on
from poise.shape import DEFAULT_SEGMENTATION, HIDDEN_OFF, Segmentation, SegmentationOptions, segment
from poise.types import Array, Cancelled, Mask, Progress

_LEAST_DEPTH = 0.05
"""Share of the pixels that have to have depth, in the middle one of the frames."""
_EVERY = 8
"""Rows of a depth image, one of which is asked whether it has depth."""
_THICK = 2e-3
_AGREED = 0.9
"""Share of the surface that views agree on, below which it is said; those of a scene at rest agree on 0.97 and more."""
_MOVED = 1e-2
"""m that a pose is moved, from which on something is wrong besides calibration."""
SEEN_OFF = 0.7e-3
"""m that seen points are off their surface."""
SCANNED_FROM = 2 * HIDDEN_OFF
"""m over the support, from which on a scan shows the shape of an object."""


@dataclass(frozen=True)
class ScanOptions:
    """How to scan.

    Args:
        voxel: m, spacing of the seen points.
        cell: m, spacing of the completed points.
        farthest: m from the camera up to which it is looked at.
        region: (6,) m in the world: middle of the bottom and size of a box; objects outside are not seen. None: all.
        near: (3,) m in the world: of several objects, the one nearest to it (the grasp); None: nearest to where the
            camera looks.
        up: (3,) against gravity, in the world.
        refine: poses by ICP: when the views disagree, always, or never; and, unless never, depth that is too long or
            too short by a share.
        complete: fill what is hidden over the table.
        seed: of the search for the table.
    """

    voxel: float = 1.5e-3
    cell: float = 2e-3
    farthest: float = 1.2
    region: tuple[float, float, float, float, float, float] | None = None
    near: tuple[float, float, float] | None = None
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    refine: Literal["auto", "always", "never"] = "auto"
    complete: bool = True
    seed: int = 0


DEFAULT_SCAN = ScanOptions()


@dataclass(frozen=True, eq=False)
class Scan:
    """The surface of one object.

    Args:
        points: (N, 3) m in the world.
        colours: (N, 3) 0..1, or None; a completed point has that of the nearest seen one.
        normals: (N, 3) out of the object.
        seen: (N,) False where completed.
        plane: what it stands on.
        n_objects: that stood there.
        n_views: that were used.
        moved: m, the most that a pose was moved at the object.
        agreed: share of the surface that the views agree on.
        notes: what to read it with, one sentence each.
        doubt: (N,) m, one sigma of where completed points are; 0 where seen; None: as `poise.shape` takes it.
    """

    points: Array
    colours: Array | None
    normals: Array
    seen: Mask
    plane: Plane
    n_objects: int
    n_views: int
    moved: float
    agreed: float
    notes: tuple[str, ...] = ()
    doubt: Array | None = None

    def __repr__(self) -> str:
        return f"Scan({self.seen.sum()} points seen and {(~self.seen).sum()} completed, {self.n_views} views)"

    def segmented(self, options: SegmentationOptions = DEFAULT_SEGMENTATION) -> Segmentation:
        """Its solid and parts; `solid.volume_std` includes what was not seen."""
        return segment(self.points, self.colours, options, normals=self.normals, seen=self.seen, doubt=self.doubt)

    @property
    def foot(self) -> Array:
        """(3,) m: the middle of its bounding box, on the table; the origin of its frame, whose axes are the world's."""
        middle = (self.points.min(axis=0) + self.points.max(axis=0)) / 2
        return np.asarray(middle - (self.plane.normal @ middle - self.plane.offset) * self.plane.normal)


def scan(
    views: Sequence[View],
    options: ScanOptions = DEFAULT_SCAN,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> Scan:
    """Scan the object that the views show.

    Raises:
        InputError: EMPTY without views or object, SCAN_INCOMPLETE when there is no table, when the views show too
            little of the object or disagree, BAD_INPUT for depth in another unit.
        NoAnswerError: CANCELLED.
    """

    def reach(share: float) -> None:
        progress(share)
        if cancelled():
            raise NoAnswerError(ErrorCode.CANCELLED, "scan: cancelled")

    _check_depth(views, options)
    reach(0.0)
    table = _table(views, options)
    views, said = _of_true_depth(views, table[1], options)
    plane, footprint, n_objects, notes = _look(views, options, None if said else table)
    reach(0.2)
    moved = 0.0
    if _wants_refinement(views, plane, options):
        views, shifts = refined(views, footprint, options.voxel)
        moved = float(shifts.max())
        typical = 1e3 * float(np.median(shifts))
        said.append(f"poses were refined: by {typical:.1f} mm (median), {1e3 * moved:.1f} mm at most")
        reach(0.4)
        plane, footprint, n_objects, notes = _look(views, options)
    notes += said
    notes += _thick(plane)
    views, footprint, surface, pushed = _fused(views, footprint, options)
    notes += pushed
    if surface.agreed < _AGREED:
        notes.append(f"the views agree on {surface.agreed:.0%} of the surface only")
    reach(0.8)
    hidden = complete(surface, views, footprint, options.cell) if options.complete else None
    if hidden is not None:
        notes += judge(hidden)
    reach(1.0)
    whole = surface if hidden is None else _joined(surface, hidden)
    seen = np.arange(len(whole.points)) < len(surface.points)
    cloud = whole.points, whole.colours, whole.normals, seen
    doubt = None if hidden is None else _doubt(len(surface.points), hidden.doubt, bool(pushed))
    return Scan(*cloud, plane, n_objects, len(views), moved, surface.agreed, tuple(notes), doubt)


def _doubt(n_seen: int, completed: Array, pushed: bool) -> Array:
    """(N,) doubt of each point; that of `n_seen` points is zero.

    After a push half of the views are where they were fitted to, and shapes are less certain.
    """
    return np.append(np.zeros(n_seen), np.maximum(completed, HIDDEN_OFF if pushed else 0.0))


def _thick(plane: Plane) -> list[str]:
    """A note where the table is seen too thick."""
    if plane.thickness <= _THICK:
        return []
    return [
        f"the table is seen {1e3 * plane.thickness:.1f} mm thick: the hand-eye transform does not fit, or the"
        " clocks of camera and joint_states"
    ]


def _of_true_depth(views: Sequence[View], plane: Plane, options: ScanOptions) -> tuple[Sequence[View], list[str]]:
    """The views with their depth corrected by the table, and what was done as a note; no note: nothing was."""
    share = depth_scale(views, plane, options.farthest) if options.refine != "never" else 0.0
    if not share:
        return views, []
    note = (
        f"depth is {100 * abs(share):.1f} % too {'long' if share > 0 else 'short'}, by the table's height in views"
        " from high and low, and was corrected; calibrate the camera, or its hand-eye transform along its axis"
    )
    return rescaled(views, share), [note]


def _fused(
    views: Sequence[View], footprint: Footprint, options: ScanOptions
) -> tuple[Sequence[View], Footprint, Surface, list[str]]:
    """The seen surface; of an object that was pushed once, with the views before moved along with it; and notes.

    Raises:
        InputError: as `fuse`; SCAN_INCOMPLETE when the views before and after a push do not fit together.
    """
    if (move := find_move(views, footprint)) is None:
        return views, footprint, fuse(views, footprint, options.voxel), []
    as_it_is = _agreed_surface(views, footprint, options)
    moved, there, together = move.undone(views), footprint, None
    try:
        there = _look(moved, replace(options, near=move.place(footprint)))[1]
        together = _agreed_surface(moved, there, options)
    except InputError:  # nothing is to be seen there
        if as_it_is is None:
            raise
    if as_it_is is not None and (together is None or together.agreed <= as_it_is.agreed) and as_it_is.agreed > _AGREED:
        return views, footprint, as_it_is, []
    if together is None or together.agreed < _AGREED:
        apart = f"{move}; the views before and after do not fit together"
        if as_it_is is None or move.distance > _MOVED:
            raise InputError(ErrorCode.SCAN_INCOMPLETE, f"scan: {apart}: fix the object to the table and scan again")
        return views, footprint, as_it_is, [apart]
    note = f"{move}; the views before were taken along with the object, which stands where it was seen last"
    return moved, there, together, [note]


def _agreed_surface(views: Sequence[View], footprint: Footprint, options: ScanOptions) -> Surface | None:
    """What views show of an object; None when they disagree."""
    try:
        return fuse(views, footprint, options.voxel)
    except InputError as error:
        if not error.data.get("disagree"):
            raise
        return None


def scan_sweep(
    sweep: Sweep,
    options: ScanOptions = DEFAULT_SCAN,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> Scan:
    """Scan what a sweep shows; when its views disagree, the error says what would make them agree.

    Raises:
        InputError, NoAnswerError: as `scan`.
    """
    up = np.array(options.up) / np.linalg.norm(options.up)
    try:
        found = scan(sweep.views, options, progress, cancelled)
    except InputError as error:
        cause = likely_cause(sweep, up, options.farthest) if error.data.get("disagree") else ""
        raise (InputError(error.code, f"{error.message}; {cause}", **error.data) if cause else error) from error
    doubtful = found.plane.thickness > _THICK or found.moved > _MOVED or found.agreed < _AGREED
    cause = likely_cause(sweep, up, options.farthest) if doubtful else ""
    return replace(found, notes=(*found.notes, cause)) if cause else found


def places_of(views: Sequence[View], options: ScanOptions = DEFAULT_SCAN) -> Array:
    """(K, 3) m in the world: the middles of the objects on the table, the largest first.

    Raises:
        InputError: as `scan`.
    """
    _check_depth(views, options)
    points, plane = _table(views, options)
    return objects_on(_regarded(points, plane, options), plane)[1]


def _regarded(points: Array, plane: Plane, options: ScanOptions) -> Array:
    """The points, of which those outside the region are laid onto the table: they are known, but nothing rises there.

    Raises:
        InputError: EMPTY when there are none in the region.
    """
    if options.region is None:
        return points
    middle, size = np.array(options.region[:3]), np.array(options.region[3:])
    offset = points - middle
    inside = np.all(np.abs(offset[:, :2]) <= size[:2] / 2, axis=1) & (offset[:, 2] <= size[2])
    if not inside.any():
        raise InputError(
            ErrorCode.EMPTY,
            f"scan: no view shows anything in the region of {size.tolist()} m at {middle.tolist()}: check it (x y z of"
            " the middle of its bottom, and its size, m, in the robot's base)",
        )
    return np.where(inside[:, None], points, points - plane.heights(points)[:, None] * plane.normal)


def _joined(surface: Surface, hidden: Completed) -> Surface:
    """Both, what was seen first; what was not has the colours of what was, nearby."""
    nearest = cKDTree(surface.points).query(hidden.points)[1]
    colours = None if surface.colours is None else np.concatenate([surface.colours, surface.colours[nearest]])
    points, normals = np.concatenate([surface.points, hidden.points]), np.concatenate([surface.normals, hidden.normals])
    return Surface(points, colours, normals, np.append(surface.weights, np.zeros(len(hidden.points))))


def _wants_refinement(views: Sequence[View], plane: Plane, options: ScanOptions) -> bool:
    if options.refine != "auto":
        return options.refine == "always"
    return not all(view.sure for view in views) or table_misfit(views, plane) > MISFIT


def _check_depth(views: Sequence[View], options: ScanOptions) -> None:
    """Report depth that cannot be used."""
    if not views:
        raise InputError(ErrorCode.EMPTY, "scan: there is no view; record depth, camera_info and joint_states together")
    shares = [float(np.mean(view.frame.depth[::_EVERY] > 0)) for view in views]
    if np.median(shares) < _LEAST_DEPTH:
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE,
            f"scan: only {np.median(shares):.0%} of the pixels have depth (in the middle one of {len(views)} views); a"
            " D435 sees nothing nearer than 0.17 m, nor glass and mirrors: move the camera back, or choose the topic",
        )
    depths = np.concatenate([view.frame.depth[::_EVERY].ravel() for view in views[:: max(len(views) // 8, 1)]])
    typical = float(np.median(depths[depths > 0]))
    if typical > 2 * options.farthest:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"scan: depth is typically {typical:.2g} m, and only what is within {options.farthest:g} m is looked at; if"
            " the depth has another unit than millimetres, give it (depth_unit), else bring the camera nearer",
        )


def _table(views: Sequence[View], options: ScanOptions) -> tuple[Array, Plane]:
    """Some points (N, 3) m of all views, and the table that they show."""
    points = coarse_points(views, options.farthest)
    up = np.array(options.up) / np.linalg.norm(options.up)
    return points, find_plane(points, up, np.random.default_rng(options.seed))


def _look(
    views: Sequence[View], options: ScanOptions, table: tuple[Array, Plane] | None = None
) -> tuple[Plane, Footprint, int, list[str]]:
    """The table, which may be known, the object's place on it, how many stand there, and notes."""
    points, plane = table or _table(views, options)
    footprints, middles = objects_on(_regarded(points, plane, options), plane)
    given = options.near if options.near is not None or options.region is None else options.region[:3]
    wanted = _regard(views, plane) if given is None else np.array(given)
    apart = np.linalg.norm((middles - wanted) @ plane.axes[:2].T, axis=1)
    chosen = int(np.argmin(apart))
    if len(footprints) == 1:
        return plane, footprints[0], 1, []
    places = "; ".join(f"({', '.join(f'{value:.3f}' for value in middle)})" for middle in middles)
    why = "where the camera looks" if given is None else "the point or region that was given"
    note = (
        f"{len(footprints)} objects stand on the table, at {places} m: the one at"
        f" ({', '.join(f'{value:.3f}' for value in middles[chosen])}) was taken, nearest to {why}; choose by a point"
    )
    return plane, footprints[chosen], len(footprints), [note]


def _regard(views: Sequence[View], plane: Plane) -> Array:
    """(3,) m: the point of the table that the optical axes meet, in the middle."""
    eyes = np.array([view.translation_world_camera for view in views])
    axes = np.array([view.rotation_world_camera[:, 2] for view in views])
    falls = axes @ plane.normal
    meets = falls < -0.05
    if not meets.any():
        return np.asarray(eyes.mean(axis=0))
    reach = (plane.offset - eyes[meets] @ plane.normal) / falls[meets]
    return np.asarray(np.median(eyes[meets] + reach[:, None] * axes[meets], axis=0))
