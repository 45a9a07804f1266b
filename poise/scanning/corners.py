"""Depth that is too long in corners, as a time-of-flight camera's: the table beside an object shows it.

Light that table and object reflect onto each other arrives late (multipath), so that both are seen farther away. All
views share this error, and agree. But the table is flat, and is then seen lower beside the object than elsewhere.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage

from poise.scanning.flatness import few_of
from poise.scanning.frames import View
from poise.scanning.fusion import pixels_of
from poise.scanning.support import NEAR, Footprint

_PIXELS = 6000
"""Of a view, that are asked for."""
_BESIDE, _AWAY = 3, (8, 25)
"""Cells from what rises over the table: up to these it is beside the object, and between these it is elsewhere."""
_BORDER = 2
"""Cells by which a footprint is wider than what rises."""
_FEW, _FEWEST_VIEWS = 15, 5
"""Pixels of a view in either place, and views, below which nothing is known."""
_LEAST, _SURE = 1.6e-4, 4.0
"""m, and standard errors, from which on the table is seen lower: less moves the surface by less than 0.4 mm."""
_SIDES = 2.5
"""Of this depth, by which the seen surface is off on average: a single reflection between a table and upright walls of
30 to 100 mm moves the walls by 4.6 to 6.5 times as much as the table 3 to 9 mm beside them, and sides are half of what
is seen of an object."""


def sunken(views: Sequence[View], footprint: Footprint, farthest: float) -> float:
    """m by which views see the table lower beside the object than elsewhere; 0 where they do not, or show too little.

    Each view is compared with itself, so that errors of the poses do not count.

    Args:
        views: of a sweep.
        footprint: where the object stands.
        farthest: m from the camera up to which it is looked at.
    """
    rings = _rings(footprint)
    lower = [low for view in few_of(views) if (low := _lower(view, rings, farthest)) is not None]
    if len(lower) < _FEWEST_VIEWS:
        return 0.0
    middle = float(np.median(lower))
    spread = 1.4826 * float(np.median(np.abs(np.array(lower) - middle)))
    return middle if middle > max(_LEAST, _SURE * 1.25 * spread / np.sqrt(len(lower))) else 0.0


def pushed_back(low: float) -> float:
    """m, one sigma, by which all of the seen surface may be off inwards, where the table is seen lower beside it."""
    return _SIDES * low


def _rings(footprint: Footprint) -> tuple[Footprint, Footprint]:
    """The cells beside the object, and those of the table elsewhere."""
    rises = ndimage.binary_erosion(footprint.cells, iterations=_BORDER)
    apart = ndimage.distance_transform_edt(~rises)
    least, most = _AWAY
    beside, away = (apart > 1) & (apart <= _BESIDE), (apart > least) & (apart <= most)
    return replace(footprint, cells=beside), replace(footprint, cells=away)


def _lower(view: View, rings: tuple[Footprint, Footprint], farthest: float) -> float | None:
    """m by which a view sees the table lower beside the object than elsewhere; None where it shows too little."""
    plane = rings[0].plane
    x, y, heights = plane.placed(pixels_of(view, _PIXELS, farthest)).T.astype(np.float64)
    level = np.abs(heights) < max(NEAR, 3 * plane.thickness)
    beside, away = (heights[level & ring.holds(x, y)] for ring in rings)
    if min(len(beside), len(away)) < _FEW:
        return None
    return float(np.median(away) - np.median(beside))
