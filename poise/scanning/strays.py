"""Views that are nowhere near where their poses say, or that something covers: what they show no other view sees."""

from collections.abc import Sequence

import numpy as np

from poise.scanning.frames import View
from poise.scanning.fusion import agreement, fewest_views, pixels_of
from poise.scanning.looking import each
from poise.scanning.support import TALLEST, Plane

_FEWEST = 12
"""Views, from which on single ones can be found to be wrong."""
_PIXELS, _ASKED = 2000, 200
"""Of a view, that are looked at, and of which rise over the table, that are asked for in all views at most."""
_LEAST = 20
"""Pixels over the table, that a view has to show."""
_LONELY, _USUAL, _MOST = 0.5, 0.1, 0.2
"""Share of a view's pixels that no other view sees and several look through, from which on it is wrong; the same in the
middle of all views, up to which it is an error of single views; and the largest share of the views that may be wrong.
"""


def without_strays(views: Sequence[View], plane: Plane, farthest: float) -> tuple[Sequence[View], list[str]]:
    """The views whose things others see, too, and what was left out as a note; no note: nothing was.

    Args:
        views: of a sweep.
        plane: the table.
        farthest: m from the camera, up to which pixels count.
    """
    if len(views) < _FEWEST:
        return views, []

    def raised(view: View) -> np.ndarray:
        points = pixels_of(view, _PIXELS, farthest)
        heights = plane.heights(points)
        over = points[(heights > plane.tolerance) & (heights < TALLEST)]
        return over[:: len(over) // _ASKED + 1]

    asked = each(views, raised)
    counts = np.array([len(points) for points in asked])
    if not counts.any():
        return views, []
    agree, through, _ = agreement(views, np.concatenate(asked).astype(np.float64))
    least = fewest_views(len(views))
    lonely = (agree < least) & (through >= least)
    owners = np.repeat(np.arange(len(views)), counts)
    shares = np.bincount(owners, lonely, minlength=len(views)) / np.maximum(counts, 1)
    wrong = (counts >= _LEAST) & (shares > _LONELY)
    if not wrong.any() or np.median(shares[counts > 0]) > _USUAL or wrong.mean() > _MOST:
        return views, []
    seconds = ", ".join(f"{1e-9 * views[number].frame.stamp:.2f}" for number in np.flatnonzero(wrong)[:5])
    note = (
        f"{wrong.sum()} of {len(views)} views show things where the others see none (at {seconds} s), and were left"
        " out: their poses are wrong, or something was before the camera"
    )
    return [view for view, stray in zip(views, wrong, strict=True) if not stray], [note]
