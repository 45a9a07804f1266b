"""Whether an object tips easily: a small facet of a scanned mesh may stand for a round side."""

from dataclasses import dataclass

import numpy as np
import shapely

from poise.assembly import Analysis, RigidObject
from poise.geometry import plane_axes, unit
from poise.types import Array

_FROM_ABOVE = -0.02
"""Cosine between a contact's normal, into the object, and up, below which the contact holds it down."""


@dataclass(frozen=True)
class Steady:
    """A test of a placement: to tip over any edge of its support, the centre of mass has to rise.

    Args:
        rise: m, at least; the error of a scan is about 1 mm.
    """

    rise: float

    def __call__(self, analysis: Analysis, item: RigidObject) -> bool:
        return tipping_rise(analysis, item) >= self.rise


def tipping_rise(analysis: Analysis, item: RigidObject) -> float:
    """m by which the centre of mass rises before the object tips over, least of the edges of its support.

    The support is the convex hull, seen from above, of the points where something carries the object or supports it
    from the side. 0 where they do not enclose the centre of mass.

    Args:
        analysis: of the assembly with the object.
        item: the object there.
    """
    up = -unit(np.asarray(analysis.assembly.gravity))
    points = _supports(analysis, analysis.assembly.index[item.id], up)
    if len(points) < 3:
        return 0.0
    return max(rise_to_tip(points, item.com_in_world, up), 0.0)


def rise_to_tip(points: Array, middle: Array, up: Array) -> float:
    """m by which a centre of mass rises before a body tips over an edge of its support; -1 where it is outside of it.

    Args:
        points: (N, 3) m, of the support.
        middle: (3,) m, the centre of mass.
        up: (3,) unit vector.
    """
    axes = plane_axes(up)
    flat = points @ axes.T
    hull = shapely.convex_hull(shapely.multipoints(flat))
    if hull.geom_type != "Polygon" or not shapely.contains_xy(hull, *(axes @ middle)):
        return -1.0
    outline = shapely.get_coordinates(hull)
    away = np.linalg.norm(flat - outline[:, None], axis=2)
    corners = points[away.argmin(axis=1)]
    return float(_rises(corners[:-1], corners[1:], middle, up).min())


def _supports(analysis: Analysis, place: int, up: Array) -> Array:
    """(N, 3) m, the corners of the contacts of an object that do not hold it down."""
    found = [
        interface.points
        for interface in analysis.structure.interfaces
        if place in (interface.first, interface.second)
        and (1 if interface.second == place else -1) * float(interface.normal @ up) > _FROM_ABOVE
    ]
    return np.concatenate(found) if found else np.zeros((0, 3))


def _rises(first: Array, second: Array, middle: Array, up: Array) -> Array:
    """(N,) m from a centre of mass to the highest point of its circle about each line through two points, (N, 3) m."""
    along = (second - first) / np.linalg.norm(second - first, axis=1, keepdims=True)
    lever = middle - first
    lever = lever - np.sum(lever * along, axis=1, keepdims=True) * along
    across = np.linalg.norm(up - (along @ up)[:, None] * along, axis=1)
    return np.asarray(np.linalg.norm(lever, axis=1) * across - lever @ up)
