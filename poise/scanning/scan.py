"""From views to the cloud of one object: seen, completed down to the table, and what is not trusted about it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.scanning.causes import likely_cause
from poise.scanning.completion import Completed, complete
from poise.scanning.depth_scale import depth_scale, rescaled
from poise.scanning.frames import View
from poise.scanning.fusion import Surface, fuse
from poise.scanning.judging import judge
from poise.scanning.moves import find_move
from poise.scanning.options import DEFAULT_SCAN, ScanOptions
from poise.scanning.placing import Sweep
from poise.scanning.pose_doubt import SurfaceDoubt, pose_doubt
from poise.scanning.registration import MISFIT, refined, table_misfit
from poise.scanning.shared_errors import Delayed, Path, without_shared, words_of
from poise.scanning.support import Footprint, Plane, objects_on
from poise.scanning.table_top import check_depth, look_at, regarded, table_of, up_of
from poise.shape import DEFAULT_SEGMENTATION, HIDDEN_OFF, Segmentation, SegmentationOptions, segment
from poise.types import Array, Cancelled, Mask, Progress

_THICK = 2e-3
_AGREED = 0.9
"""Share of the surface that views agree on, below which it is said; those of a scene at rest agree on 0.97 and more."""
_UNCERTAIN = 4e-4
"""m that the poses may have put the surface elsewhere, from which on it is said."""
_WORSE = 5e-3
"""Of this share, that corrected poses may take away."""
_MOVED = 1e-2
"""m that a pose is moved, from which on something is wrong besides calibration."""
SEEN_OFF = 0.7e-3
"""m that seen points are off their surface."""
SCANNED_FROM = 2 * HIDDEN_OFF
"""m over the support, from which on a scan shows the shape of an object."""


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
        doubt: (N,) m, one sigma of where completed points are, and of where the poses may have put all seen ones; None:
            as `poise.shape` takes it.
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
        """Its solid and parts; `solid.volume_std` includes what was not seen, and the errors of the poses."""
        return segment(self.points, self.colours, options, normals=self.normals, seen=self.seen, doubt=self.doubt)

    @property
    def foot(self) -> Array:
        """(3,) m: the middle of its bounding box, on the table; the origin of its frame, whose axes are the world's."""
        middle = (self.points.min(axis=0) + self.points.max(axis=0)) / 2
        return np.asarray(middle - (self.plane.normal @ middle - self.plane.offset) * self.plane.normal)


@dataclass(frozen=True, eq=False)
class _Observed:
    """What views show of an object, and what has to be said of it.

    Args:
        views: whose poses were refined, and in which the object stands still.
        footprint: where it stands.
        n_objects: that stand there.
        surface: what is seen.
        moved: m, the most that a pose was moved at the object.
        pushed: whether the object was.
        doubt: of the poses.
        notes: one sentence each.
    """

    views: Sequence[View]
    footprint: Footprint
    n_objects: int
    surface: Surface
    moved: float
    pushed: bool
    doubt: SurfaceDoubt
    notes: list[str]


def scan(
    views: Sequence[View],
    options: ScanOptions = DEFAULT_SCAN,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
    delayed: Delayed | None = None,
) -> Scan:
    """Scan the object that the views show.

    Args:
        views: of a sweep.
        options: how.
        progress, cancelled: called between steps.
        delayed: the views, were the images' stamps late by so many s more; None: along a spline through their poses.

    Raises:
        InputError: EMPTY without views or object, SCAN_INCOMPLETE when there is no table, when the views show too
            little of the object or disagree, BAD_INPUT for depth in another unit.
        NoAnswerError: CANCELLED.
    """

    def reach(share: float) -> None:
        progress(share)
        if cancelled():
            raise NoAnswerError(ErrorCode.CANCELLED, "scan: cancelled")

    check_depth(views, options)
    reach(0.0)
    found, said = _best(views, Path.of(views, delayed), options, reach)
    surface, notes = found.surface, said + found.notes + _uncertain(found.doubt)
    if surface.agreed < _AGREED:
        notes.append(f"the views agree on {surface.agreed:.0%} of the surface only")
    reach(0.8)
    hidden = complete(surface, found.views, found.footprint, options.cell) if options.complete else None
    if hidden is not None:
        notes += judge(hidden)
    reach(1.0)
    whole = surface if hidden is None else _joined(surface, hidden)
    seen = np.arange(len(whole.points)) < len(surface.points)
    cloud = whole.points, whole.colours, whole.normals, seen
    doubt = None if hidden is None else _doubt(len(surface.points), found, hidden.doubt)
    counts = found.n_objects, len(found.views), found.moved
    return Scan(*cloud, found.footprint.plane, *counts, surface.agreed, tuple(notes), doubt)


def _best(
    views: Sequence[View], path: Path, options: ScanOptions, reach: Callable[[float], None]
) -> tuple[_Observed, list[str]]:
    """What the views show without the errors that all poses share, and what these were.

    Raises:
        InputError, NoAnswerError: as `scan`.
    """
    if options.refine == "never":
        return _observed(views, path, options, reach), []
    try:
        table = table_of(views, options)
    except InputError:  # with these poses
        table = None
    views, path, said = without_shared(views, path, table and table[1], options.farthest)
    found = _observed(views, path, options, reach, None if said else table)
    return _agreeing(found, path, options, reach), said


def _observed(
    views: Sequence[View],
    path: Path,
    options: ScanOptions,
    reach: Callable[[float], None],
    table: tuple[Array, Plane] | None = None,
) -> _Observed:
    """What the views show; the table may be known.

    Raises:
        InputError, NoAnswerError: as `scan`.
    """
    table = table or table_of(views, options)
    views, said = _of_true_depth(views, table[1], options)
    plane, footprint, n_objects, notes = look_at(views, options, None if said else table)
    reach(0.2)
    moved, as_they_were = 0.0, views
    if _wants_refinement(views, plane, options):
        views, shifts = refined(views, footprint, options.voxel)
        moved = float(shifts.max())
        typical = 1e3 * float(np.median(shifts))
        said.append(f"poses were refined: by {typical:.1f} mm (median), {1e3 * moved:.1f} mm at most")
        reach(0.4)
        plane, footprint, n_objects, notes = look_at(views, options)
    views, footprint, surface, pushed = _fused(views, footprint, options)
    # Refined views agree, whatever errors they share: what they said before has to be asked.
    asked = ([view for view in as_they_were if view.sure] or as_they_were) if moved else views
    doubt = pose_doubt(asked, path, surface, footprint.plane, options.farthest)
    notes = [*notes, *said, *_thick(plane), *pushed]
    return _Observed(views, footprint, n_objects, surface, moved, bool(pushed), doubt, notes)


def _agreeing(found: _Observed, path: Path, options: ScanOptions, reach: Callable[[float], None]) -> _Observed:
    """What the views show with poses that agree better about the surface, where the doubt of them is clear.

    Raises:
        NoAnswerError: as `scan`.
    """
    doubt = found.doubt
    if not doubt.clear or found.moved or found.pushed:
        return found
    views = rescaled(path.placed(found.views, doubt.change), doubt.share)
    try:
        again = _observed(views, replace(path, change=path.change + doubt.change), options, reach)
    except InputError:
        return found
    if again.doubt.sigma > doubt.sigma or again.surface.agreed < found.surface.agreed - _WORSE:
        return found
    known = words_of(np.where(doubt.sure[1:], doubt.change, 0.0), doubt.share if doubt.sure[0] else 0.0)
    note = (
        "views saw the same surface at different places, which was corrected:"
        f" {known or 'the hand-eye transform, the scale of depth or the clocks do not fit'}"
    )
    return replace(again, notes=[*again.notes, note])


def _doubt(n_seen: int, found: _Observed, completed: Array) -> Array:
    """(N,) doubt of each point.

    After a push half of the views are where they were fitted to, and shapes are less certain.
    """
    return np.append(np.full(n_seen, found.doubt.sigma), np.maximum(completed, HIDDEN_OFF if found.pushed else 0.0))


def _uncertain(doubt: SurfaceDoubt) -> list[str]:
    """A note where the poses may have put the surface elsewhere."""
    if doubt.sigma < _UNCERTAIN:
        return []
    return [
        f"by what views of the same surface disagree about, all of it may be off by {1e3 * doubt.sigma:.1f} mm, which"
        " volume_std includes: the hand-eye transform, the scale of depth or the clocks do not fit (poise calibrate);"
        " views from high and low distinguish them"
    ]


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
        there = look_at(moved, replace(options, near=move.place(footprint)))[1]
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
    up = up_of(options)
    try:
        found = scan(sweep.views, options, progress, cancelled, sweep.delayed)
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
    check_depth(views, options)
    points, plane = table_of(views, options)
    return objects_on(regarded(points, plane, options), plane)[1]


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
