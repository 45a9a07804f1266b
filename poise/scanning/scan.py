"""From views to the cloud of one object: seen, completed down to the table, and what is not trusted about it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.scanning.causes import likely_cause
from poise.scanning.completion import Completed, complete
from poise.scanning.corners import Sunken, sunken
from poise.scanning.depth_scale import rescaled
from poise.scanning.frames import View
from poise.scanning.fusion import Surface, fuse
from poise.scanning.judging import judge
from poise.scanning.observing import AGREED_WELL, FAR_MOVED, THICK, Observed, observed
from poise.scanning.options import DEFAULT_SCAN, ScanOptions
from poise.scanning.placing import Sweep
from poise.scanning.pose_doubt import SurfaceDoubt, pose_doubt
from poise.scanning.shared_errors import Delayed, Path, without_shared, words_of
from poise.scanning.strays import without_strays
from poise.scanning.support import Plane
from poise.scanning.table_top import check_depth, look_at, table_of, things_on, up_of
from poise.shape import DEFAULT_SEGMENTATION, HIDDEN_OFF, Segmentation, SegmentationOptions, segment
from poise.types import Array, Cancelled, Mask, Progress

_UNCERTAIN = 4e-4
"""m that the poses may have put the surface elsewhere, from which on it is said."""
_WORSE = 5e-3
"""Of this share, that corrected poses may take away."""
_CORRECTIONS = 3
"""Times that poses are corrected by the surface, at most: one that is far off is seen in part only."""
_BETTER = 0.05
"""Of this share, that corrected poses have to add, to explain why views disagree."""
SEEN_OFF = 0.7e-3
"""m that seen points are off their surface."""
_STRAY = 0.002
"""Share of the points at each end of the object that do not say where it ends."""
_LEVELS = 255
"""Steps of a colour in a file."""
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
        doubt: (N,) m, one sigma of where completed points are, and of where the poses and corners may have put all seen
            ones; None: as `poise.shape` takes it.
        air: (K, 3) m, places near the surface that views look through, on a grid; None: not known.
        posed: m, one sigma of where the poses may have put the seen points.
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
    air: Array | None = None
    posed: float = 0.0

    def __repr__(self) -> str:
        return f"Scan({self.seen.sum()} points seen and {(~self.seen).sum()} completed, {self.n_views} views)"

    def segmented(self, options: SegmentationOptions = DEFAULT_SEGMENTATION) -> Segmentation:
        """Its solid and parts; `solid.volume_std` includes what was not seen, and the errors of the poses."""
        cut = partial(segment, normals=self.normals, seen=self.seen, doubt=self.doubt, air=self.air)
        return cut(self.points, self.colours, options)

    @property
    def foot(self) -> Array:
        """(3,) m: the middle of its bounding box, on the table; the origin of its frame, whose axes are the world's.

        The box leaves out the outermost points, so that single stray points do not move it.
        """
        middle = np.quantile(self.points, [_STRAY, 1 - _STRAY], axis=0).mean(axis=0)
        return np.asarray(middle - (self.plane.normal @ middle - self.plane.offset) * self.plane.normal)


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
    low = sunken(found.views, found.footprint, options.farthest)
    surface, notes = found.surface, said + found.notes + _uncertain(found.doubt) + _late(low.low)
    if surface.agreed < AGREED_WELL:
        notes.append(f"the views agree on {surface.agreed:.0%} of the surface only")
    if surface.sparse:
        notes.append(
            "a part of the surface is dark or shiny, and gives depth in single pixels only: it is less well known than"
            " the rest, and may be larger; powder it, or cover it with tape"
        )
    reach(0.8)
    hidden = complete(surface, found.views, found.footprint, options.cell) if options.complete else None
    if hidden is not None:
        notes += judge(hidden)
    reach(1.0)
    whole = surface if hidden is None else _joined(surface, hidden)
    seen = np.arange(len(whole.points)) < len(surface.points)
    cloud = whole.points, _stored(whole.colours), whole.normals, seen
    doubt = None if hidden is None else _doubt(found, low, hidden.doubt)
    air = None if hidden is None or found.pushed else hidden.air
    counts = found.n_objects, len(found.views), found.moved
    return Scan(*cloud, found.footprint.plane, *counts, surface.agreed, tuple(notes), doubt, air, found.doubt.sigma)


def _best(
    views: Sequence[View], path: Path, options: ScanOptions, reach: Callable[[float], None]
) -> tuple[Observed, list[str]]:
    """What the views show without the errors that all poses share, and what these were.

    Raises:
        InputError, NoAnswerError: as `scan`.
    """
    if options.refine == "never":
        return observed(views, path, options, reach), []
    try:
        table = table_of(views, options)
    except InputError:  # with these poses
        table = None
    views, path, said = without_shared(views, path, table and table[1], options.farthest)
    views, table, strays = _without_strays(views, None if said else table, options)
    said += strays
    try:
        found = observed(views, path, options, reach, table)
    except InputError as error:
        if not error.data.get("disagree"):
            raise
        return _despite(error, views, path, options, reach), said
    return _agreeing(found, path, options, reach, []), said


def _without_strays(
    views: Sequence[View], table: tuple[Array, Plane] | None, options: ScanOptions
) -> tuple[Sequence[View], tuple[Array, Plane] | None, list[str]]:
    """The views without single ones that show other things, the table where it is known, and what was left out."""
    try:
        table = table or table_of(views, options)
    except InputError:  # is reported with what the views disagree about
        return views, None, []
    kept, said = without_strays(views, table[1], options.farthest)
    return kept, None if said else table, said


def _despite(
    error: InputError, views: Sequence[View], path: Path, options: ScanOptions, reach: Callable[[float], None]
) -> Observed:
    """What views that disagree show with the poses that they agree on.

    Raises:
        InputError: the error, with `poses` where other poses explain a part of it.
        NoAnswerError: as `scan`.
    """
    try:
        plane, footprint, *_ = look_at(views, options)
        surface = fuse(views, footprint, options.voxel, 0.0)
        doubt = pose_doubt(views, path, surface, plane, options.farthest)
        views, path = _corrected(views, path, doubt)
        found = _agreeing(observed(views, path, options, reach), path, options, reach, [doubt])
    except InputError:
        raise error from None
    if found.surface.agreed >= AGREED_WELL:
        return found
    poses = found.surface.agreed > error.data.get("agreed", 1.0) + _BETTER
    raise InputError(error.code, error.message, **error.data, poses=poses) from None


def _corrected(views: Sequence[View], path: Path, doubt: SurfaceDoubt) -> tuple[Sequence[View], Path]:
    """The views and their path without what they disagree about."""
    placed = rescaled(path.placed(views, doubt.change), doubt.share)
    return placed, replace(path, change=path.change + doubt.change)


def _agreeing(
    found: Observed, path: Path, options: ScanOptions, reach: Callable[[float], None], known: Sequence[SurfaceDoubt]
) -> Observed:
    """What the views show with poses that agree better about the surface, where the doubt of them is clear.

    Args:
        found: what they show.
        path: of them.
        options, reach: as `scan`.
        known: what was corrected.

    Raises:
        NoAnswerError: as `scan`.
    """
    done = list(known)
    while len(done) < _CORRECTIONS and found.doubt.clear and not found.moved:
        views, path = _corrected(found.given, path, found.doubt)
        try:
            again = observed(views, path, options, reach)
        except InputError:
            break
        if not again.doubt.better_than(found.doubt) or again.surface.agreed < found.surface.agreed - _WORSE:
            break
        done.append(found.doubt)
        found = again
    if not done:
        return found
    sure = np.any([one.sure for one in done], axis=0)
    change, share = sum(one.change for one in done), sum(one.share for one in done)
    said = words_of(np.where(sure[1:], change, 0.0), share if sure[0] else 0.0)
    note = (
        "views saw the same surface at different places, which was corrected:"
        f" {said or 'the hand-eye transform, the scale of depth or the clocks do not fit'}"
    )
    return replace(found, notes=[*found.notes, note])


def _doubt(found: Observed, low: Sunken, completed: Array) -> Array:
    """(N,) doubt of each point, of which the seen ones may be off by the poses, and pushed back by corners.

    After a push half of the views are where they were fitted to, and shapes are less certain.
    """
    pushed_back = low.of_faces(found.surface.normals, found.footprint.plane.normal)
    return np.append(
        np.hypot(found.doubt.sigma, pushed_back),
        np.maximum(completed, HIDDEN_OFF if found.pushed else 0.0),
    )


def _uncertain(doubt: SurfaceDoubt) -> list[str]:
    """A note where the poses may have put the surface elsewhere."""
    if doubt.sigma < _UNCERTAIN:
        return []
    return [
        f"by what views of the same surface disagree about, all of it may be off by {1e3 * doubt.sigma:.1f} mm, which"
        " volume_std includes: the hand-eye transform, the scale of depth or the clocks do not fit (poise calibrate);"
        " views from high and low distinguish them"
    ]


def _late(low: float) -> list[str]:
    """A note where the table is seen lower, by so many m, beside the object."""
    if not low:
        return []
    return [
        f"the table is seen {1e3 * low:.1f} mm lower beside the object than elsewhere: depth is too long in corners, as"
        " a time-of-flight camera's, and the object is likely larger than it is seen, by an amount that volume_std"
        " includes; take another kind of camera, or a matt dark table"
    ]


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
        poses = bool(error.data.get("poses"))
        cause = likely_cause(sweep, up, options.farthest, poses) if error.data.get("disagree") else ""
        raise (InputError(error.code, f"{error.message}; {cause}", **error.data) if cause else error) from error
    doubtful = found.plane.thickness > THICK or found.moved > FAR_MOVED or found.agreed < AGREED_WELL
    poses = found.posed >= _UNCERTAIN
    cause = likely_cause(sweep, up, options.farthest, poses) if doubtful else ""
    return replace(found, notes=(*found.notes, cause)) if cause else found


def places_of(views: Sequence[View], options: ScanOptions = DEFAULT_SCAN) -> Array:
    """(K, 3) m in the world: the middles of the objects on the table, the largest first.

    Raises:
        InputError: as `scan`.
    """
    check_depth(views, options)
    points, plane = table_of(views, options)
    _, middles, standing = things_on(views, points, plane, options)
    return middles[standing]


def _stored(colours: Array | None) -> Array | None:
    """Colours (N, 3) 0..1 in the steps of a file: clusters are so sensitive that else its parts would be others."""
    return None if colours is None else levels_of(colours) / _LEVELS


def levels_of(colours: Array) -> Array:
    """(N, 3) whole numbers up to 255 of colours 0..1, as a file has them."""
    return np.asarray(np.round(_LEVELS * np.clip(colours, 0, 1)))


def _joined(surface: Surface, hidden: Completed) -> Surface:
    """Both, what was seen first; what was not has the colours of what was, nearby."""
    nearest = cKDTree(surface.points).query(hidden.points)[1]
    colours = None if surface.colours is None else np.concatenate([surface.colours, surface.colours[nearest]])
    points, normals = np.concatenate([surface.points, hidden.points]), np.concatenate([surface.normals, hidden.normals])
    return Surface(points, colours, normals, np.append(surface.weights, np.zeros(len(hidden.points))))
