"""What parallel fingers meet when they close on a body: its width, where they touch it, and whether it stays there."""

from dataclasses import dataclass

import numpy as np

from poise.types import Array

_SKIN = 5e-4
"""m: what is this near to the outermost points of a body is what the pads touch."""


@dataclass(frozen=True)
class Pads:
    """Fingers that close along y of the tool frame; their tips are at its origin.

    Args:
        width, length: m of a pad along x, and from the tip back along -z.
        radius: m of the disc that stands for what a pad touches.
        friction: Coulomb coefficient.
    """

    width: float = 0.022
    length: float = 0.04
    radius: float = 0.011
    friction: float = 0.5


@dataclass(frozen=True)
class Squeeze:
    """A body between the pads, in the tool frame.

    Args:
        low, high: m along y of its outermost points between the pads.
        centre: (3,) m, the middle of where the pads touch.
        firm: both surfaces are within the friction cones, so that it does not slip out.
    """

    low: float
    high: float
    centre: Array
    firm: bool

    @property
    def width(self) -> float:
        """m."""
        return self.high - self.low


def squeeze(triangles: Array, pads: Pads) -> Squeeze | None:
    """What the pads meet of triangles (T, 3, 3) in the tool frame, counter-clockwise from outside; None: nothing."""
    low = np.array([-pads.width / 2, -np.inf, -pads.length])
    high = np.array([pads.width / 2, np.inf, 0.0])
    near = np.all((triangles.min(axis=1) <= high) & (triangles.max(axis=1) >= low), axis=1)
    pieces = [piece for triangle in triangles[near] if len(piece := _clipped(triangle, low, high)) >= 3]
    if not pieces:
        return None
    y = np.concatenate(pieces)[:, 1]
    ends = float(y.min()), float(y.max())
    middles, firm = [], True
    for end, outward in zip(ends, (-1.0, 1.0), strict=True):
        skin = np.array([-np.inf, end - _SKIN, -np.inf]), np.array([np.inf, end + _SKIN, np.inf])
        touched = [piece for each in pieces if len(piece := _clipped(each, *skin))]
        normal = np.sum([_area(piece) for piece in touched], axis=0)
        middles.append(np.concatenate(touched).mean(axis=0))
        firm &= bool(outward * normal[1] * np.hypot(1.0, pads.friction) >= np.linalg.norm(normal) > 0)
    between = middles[1] - middles[0]
    firm &= bool(np.hypot(between[0], between[2]) <= pads.friction * between[1])
    return Squeeze(*ends, np.mean(middles, axis=0), firm)


def _clipped(polygon: Array, low: Array, high: Array) -> Array:
    """(P, 3) what of a polygon is between two bounds (3,), which may be infinite (Sutherland and Hodgman 1974)."""
    for axis in range(3):
        for sign, bound in ((1.0, low[axis]), (-1.0, -high[axis])):
            if np.isinf(bound):
                continue
            depth = sign * polygon[:, axis] - bound
            kept: list[Array] = []
            for i in range(len(polygon)):
                j = (i + 1) % len(polygon)
                if depth[i] >= 0:
                    kept.append(polygon[i])
                if (depth[i] >= 0) != (depth[j] >= 0):
                    share = depth[i] / (depth[i] - depth[j])
                    kept.append(polygon[i] + share * (polygon[j] - polygon[i]))
            polygon = np.array(kept).reshape(-1, 3)
            if not len(polygon):
                return polygon
    return polygon


def _area(polygon: Array) -> Array:
    """(3,) the normal of a flat polygon, as long as twice its area."""
    return np.asarray(np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0))
