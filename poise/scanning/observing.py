"""What the views of a sweep show of one object with the poses that they have, and what they say of these poses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.scanning.depth_scale import depth_scale, rescaled
from poise.scanning.frames import View
from poise.scanning.fusion import Surface, fuse
from poise.scanning.moves import find_move
from poise.scanning.options import ScanOptions
from poise.scanning.pose_doubt import SurfaceDoubt, pose_doubt
from poise.scanning.registration import MISFIT, refined, table_misfit
from poise.scanning.shared_errors import Path
from poise.scanning.support import Footprint, Plane
from poise.scanning.table_top import look_at, table_of
from poise.types import Array

THICK = 2e-3
"""m of a table, from which on views disagree about it."""
AGREED_WELL = 0.9
"""Share of the surface that views agree on, below which it is said; those of a scene at rest agree on 0.97 and more."""
_BETTER = 0.03
"""Of this share, by which views of either side of a push agree better than all do."""
_ALIKE, _TURNED = 0.995, np.deg2rad(1.5)
"""Share of the surface, from which on views agree that nothing was pushed by up to `FAR_MOVED`, and the turn, rad, from
which on this does not count. Thin bars at rest were pushed by 3.5 mm and turned by 0.5 deg for the search, and agreed
on 0.998; those that were, by 3 to 4 mm, on 0.91 to 0.991. What is turned by 4 deg can agree on more than this."""
FAR_MOVED = 1e-2
"""m that a pose is moved, from which on something is wrong besides calibration."""


@dataclass(frozen=True, eq=False)
class Observed:
    """What views show of an object, and what has to be said of it.

    Args:
        views: whose poses were refined, and in which the object stands still.
        given: the views before both.
        footprint: where it stands.
        n_objects: that stand there.
        surface: what is seen.
        moved: m, the most that a pose was moved at the object.
        pushed: whether the object was.
        doubt: of the poses.
        notes: one sentence each.
    """

    views: Sequence[View]
    given: Sequence[View]
    footprint: Footprint
    n_objects: int
    surface: Surface
    moved: float
    pushed: bool
    doubt: SurfaceDoubt
    notes: list[str]


def observed(
    views: Sequence[View],
    path: Path,
    options: ScanOptions,
    reach: Callable[[float], None],
    table: tuple[Array, Plane] | None = None,
) -> Observed:
    """What the views show; the table may be known.

    Raises:
        InputError, NoAnswerError: as `scan`.
    """
    table = table or table_of(views, options)
    views, said = _of_true_depth(views, table[1], options)
    given = views
    plane, footprint, n_objects, notes = look_at(views, options, None if said else table)
    reach(0.2)
    moved = 0.0
    if _wants_refinement(views, plane, options):
        views, shifts = refined(views, footprint, options.voxel)
        moved = float(shifts.max())
        typical = 1e3 * float(np.median(shifts))
        said.append(f"poses were refined: by {typical:.1f} mm (median), {1e3 * moved:.1f} mm at most")
        reach(0.4)
        plane, footprint, n_objects, notes = look_at(views, options)
    views, footprint, surface, pushed = _fused(views, footprint, options)
    # Refined views agree, whatever errors they share: what they said before has to be asked.
    asked = ([view for view in given if view.sure] or given) if moved else views
    doubt = pose_doubt(asked, path, surface, footprint.plane, options.farthest)
    notes = [*notes, *said, *_thick(plane), *pushed]
    return Observed(views, given, footprint, n_objects, surface, moved, bool(pushed), doubt, notes)


def _thick(plane: Plane) -> list[str]:
    """A note where the table is seen too thick."""
    if plane.thickness <= THICK:
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
    small = move.distance <= FAR_MOVED and abs(move.turn) < _TURNED
    if small and as_it_is is not None and as_it_is.agreed > _ALIKE:
        return views, footprint, as_it_is, []
    moved, there, together = move.undone(views), footprint, None
    try:
        there = look_at(moved, replace(options, near=move.place(footprint)))[1]
        together = _agreed_surface(moved, there, options)
    except InputError:  # nothing is to be seen there
        if as_it_is is None:
            raise
    # After a push so far views disagree about much; not so where the object looks alike after the motion, as a wheel.
    least = _BETTER if move.distance > FAR_MOVED else 0.0
    if (
        as_it_is is not None
        and (together is None or together.agreed <= as_it_is.agreed + least)
        and as_it_is.agreed > AGREED_WELL
    ):
        return views, footprint, as_it_is, []
    if together is None or together.agreed < AGREED_WELL:
        if as_it_is is not None and not _apart_only(views, move.stamp, footprint, options, as_it_is.agreed):
            return views, footprint, as_it_is, []
        apart = f"{move}; the views before and after do not fit together"
        if as_it_is is None or move.distance > FAR_MOVED:
            raise InputError(ErrorCode.SCAN_INCOMPLETE, f"scan: {apart}: fix the object to the table and scan again")
        return views, footprint, as_it_is, [apart]
    note = f"{move}; the views before were taken along with the object, which stands where it was seen last"
    return moved, there, together, [note]


def _apart_only(views: Sequence[View], stamp: int, footprint: Footprint, options: ScanOptions, agreed: float) -> bool:
    """Whether views on one side of an instant agree better than all do: else it is not a push that they disagree about.

    Depth that is wrong at edges, or an object that looks alike after a turn, lets a motion explain some of it.
    """
    sides = [view for view in views if view.frame.stamp < stamp], [view for view in views if view.frame.stamp >= stamp]
    shares = []
    for side in sides:
        try:
            shares.append(fuse(side, footprint, options.voxel, 0.0).agreed)
        except InputError:  # too few views, or nothing of it
            return True
    return float(np.mean(shares)) > agreed + _BETTER


def _agreed_surface(views: Sequence[View], footprint: Footprint, options: ScanOptions) -> Surface | None:
    """What views show of an object; None when they disagree."""
    try:
        return fuse(views, footprint, options.voxel)
    except InputError as error:
        if not error.data.get("disagree"):
            raise
        return None


def _wants_refinement(views: Sequence[View], plane: Plane, options: ScanOptions) -> bool:
    if options.refine != "auto":
        return options.refine == "always"
    return not all(view.sure for view in views) or table_misfit(views, plane) > MISFIT
