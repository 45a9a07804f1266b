"""A scanned can: the upright cylinder that explains the seen points of a scan as well as a closed surface could."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from poise.geometry import Pose
from poise.scanning.scan import SCANNED_FROM, SEEN_OFF
from poise.types import Array, Mask

_UNEVEN = 0.2e-3
"""m that the medians of seen points over pieces of the side may be off it; root of the mean square."""
_PIECES, _LAYERS = 24, 3
"""Angles around the axis, and heights, over each of which the median distance is tested."""
_LEAST_POINTS, _LEAST_IN_PIECE = 100, 8
_COVERED = 0.75
"""Share of the pieces that have to be seen: of a half cylinder the round side alone may be seen."""
_RIM = 0.003
"""m beside the upper edge that are not used: a scan rounds it."""
_FAR, _OUTSIDE, _INSIDE = 2e-3, 0.005, 0.1
"""m, and the shares of the points that may be farther outside and inside than that: a scan rounds edges."""


class StandingCylinder(NamedTuple):
    """An upright cylinder in the object frame, whose base is at z = 0.

    Args:
        middle: (2,) m, x and y of its axis.
        radius, height: m.
    """

    middle: Array
    radius: float
    height: float

    @property
    def volume(self) -> float:
        """m3."""
        return float(np.pi * self.radius**2 * self.height)

    @property
    def pose(self) -> Pose:
        """Of the frame in its centre, in the object frame."""
        return Pose(np.eye(3), np.array([*self.middle, self.height / 2]))


def standing_cylinder(points: Array, seen: Mask) -> StandingCylinder | None:
    """The upright cylinder of a scanned can; None when the object is another, or too little of it was seen.

    An axis that leans and a radius that changes with the height are fitted with the circle, by least squares on the
    points of the side. A cylinder is accepted when lean and taper move the surface by less than the noise of a scan,
    when the side was seen nearly all around, and when the distances to the cylinder are noise: small in all, and small
    in the middle over each piece of the side. So prisms of few sides, cones and cups are none.

    Args:
        points: (N, 3) m of the scan; its z points away from the support, which is z = 0.
        seen: (N,) False for the points that were completed.
    """
    used = points[seen & (points[:, 2] > SCANNED_FROM)]
    if len(used) < _LEAST_POINTS:
        return None
    highest = float(np.quantile(used[:, 2], 0.99))
    start = _circle(used[used[:, 2] < highest - _RIM])
    if start is None:
        return None
    away = np.linalg.norm(used[:, :2] - start[:2], axis=1)
    covers = used[(away < start[2] - _RIM) & (used[:, 2] > highest - _RIM), 2]
    height = float(np.median(covers)) if len(covers) >= _LEAST_POINTS // 4 else 0.0
    side = used[(away > start[2] - _FAR) & (used[:, 2] < height - _RIM)]
    if len(side) < _LEAST_POINTS or height < 2 * (SCANNED_FROM + _RIM):
        return None
    fitted = least_squares(_off_cone, [*start, 0.0, 0.0, 0.0], args=(side, height), loss="soft_l1", f_scale=SEEN_OFF)
    if np.abs(fitted.x[3:]).max() > SEEN_OFF:
        return None
    found = StandingCylinder(fitted.x[:2], float(fitted.x[2]), height)
    return found if _explains(found, used, side) else None


def _circle(points: Array) -> Array | None:
    """(3,) m: middle and radius of the circle through points seen from above, by linear least squares."""
    if len(points) < _LEAST_POINTS:
        return None
    flat = points[:, :2]
    a, b, c = np.linalg.lstsq(np.column_stack([2 * flat, np.ones(len(flat))]), np.sum(flat**2, axis=1))[0]
    square = float(c + a * a + b * b)
    return np.array([a, b, np.sqrt(square)]) if square > _RIM**2 else None


def _off_cone(values: Array, side: Array, height: float) -> Array:
    """(N,) m from a cone: its middle and radius at half of the height, and m that both change up to its top."""
    share = 2 * side[:, 2] / height - 1
    away = side[:, :2] - values[:2] - share[:, None] * values[3:5]
    return np.asarray(np.linalg.norm(away, axis=1) - values[2] - share * values[5])


def _explains(found: StandingCylinder, used: Array, side: Array) -> bool:
    """Whether the distances of the points to the surface are noise, and enough of the side was seen."""
    out = np.linalg.norm(used[:, :2] - found.middle, axis=1) - found.radius
    over = used[:, 2] - found.height
    outside = np.hypot(np.maximum(out, 0), np.maximum(over, 0))
    off = np.where((out > 0) | (over > 0), outside, np.maximum(out, over))
    near = np.abs(off) < _FAR
    if np.mean(off > _FAR) > _OUTSIDE or np.mean(off < -_FAR) > _INSIDE or np.sqrt(np.mean(off[near] ** 2)) > SEEN_OFF:
        return False
    away = side[:, :2] - found.middle
    angle = np.floor((np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) % 1.0) * _PIECES).astype(int) % _PIECES
    layer = np.floor((side[:, 2] - SCANNED_FROM) / (found.height - _RIM - SCANNED_FROM) * _LAYERS).astype(int)
    piece = angle * _LAYERS + np.clip(layer, 0, _LAYERS - 1)
    rough = np.linalg.norm(away, axis=1) - found.radius
    pieces = [rough[piece == number] for number in range(_PIECES * _LAYERS)]
    middles = np.array([np.median(each) for each in pieces if len(each) >= _LEAST_IN_PIECE])
    return len(middles) >= _COVERED * len(pieces) and float(np.sqrt(np.mean(middles**2))) < _UNEVEN
