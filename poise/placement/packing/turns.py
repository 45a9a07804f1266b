"""The orientations in which an object is packed: on a face that it stands on, its sides along the container's."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import ConvexHull

from poise.assembly import Cylinder, RigidObject
from poise.geometry import Pose, rotation_about, rotation_between
from poise.placement import ContactFeatures
from poise.placement.packing.cover import Cover, cover_of
from poise.types import Array

_FACES = 8
"""Faces that an object is put on, at most: the largest that it stands on."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Turned:
    """An object in one orientation, the lowest corner of its bounds at the origin.

    Args:
        pose: of the object frame, in the container's axes.
        cover: boxes around it.
        size: (3,) m, of its bounds.
        com: (3,) m.
    """

    pose: Pose
    cover: Cover
    size: Array
    com: Array


def turns_of(
    item: RigidObject, steady: Callable[[Array, Array], bool], allowed: Callable[[Array], bool]
) -> list[Turned]:
    """The orientations of an object, the lowest first; none when it would roll or tip in all of them.

    Args:
        item: at any pose.
        steady: whether the object stands on a face with some (N, 3) corners, m, below a centre of mass (3,).
        allowed: whether a rotation (3, 3), from the object to the container's axes, is wanted.
    """
    polyhedron = item.shape.polyhedron
    com = np.asarray(item.shape.centroid if item.com is None else item.com)
    found: dict[bytes, Turned] = {}
    for normal in _downwards(item):
        down = rotation_between(normal, -_UP)
        corners = polyhedron.vertices @ down.T
        lowest = corners[corners[:, 2] < corners[:, 2].min() + 1e-6]
        if not steady(lowest, down @ com):
            continue
        angle = _alignment(corners)
        for quarter in range(4):
            rotation = rotation_about(_UP, quarter * np.pi / 2 - angle) @ down
            corners = polyhedron.vertices @ rotation.T
            low = corners.min(axis=0)
            key = _same_place(corners - low, rotation @ com - low)
            if key not in found and allowed(rotation):
                cover = cover_of(polyhedron, corners - low)
                size = np.ptp(corners, axis=0)
                found[key] = Turned(Pose(rotation, -low), cover, size, rotation @ com - low)
    return sorted(found.values(), key=lambda turned: float(turned.size[2]))


def _downwards(item: RigidObject) -> list[Array]:
    """Normals of the faces that it stands on; of a cylinder the flat ends, on its side it would roll."""
    normals = [face.normal for face in ContactFeatures.of(item.shape, item.com).faces if face.steady]
    if isinstance(item.shape, Cylinder):
        normals = [normal for normal in normals if abs(normal[2]) > 0.5]
    return normals[:_FACES]


def _alignment(corners: Array) -> float:
    """rad: the direction of a side of the smallest rectangle around corners, seen from above."""
    hull = corners[:, :2][ConvexHull(corners[:, :2]).vertices]
    sides = np.roll(hull, -1, axis=0) - hull
    angles = np.unique(np.round(np.arctan2(sides[:, 1], sides[:, 0]) % (np.pi / 2), 9))
    turned = [hull @ np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in angles]
    return float(angles[int(np.argmin([np.round(np.prod(np.ptp(t, axis=0)), 12) for t in turned]))])


def _same_place(corners: Array, com: Array) -> bytes:
    """Equal for orientations that fill the same room with the same centre of mass."""
    points = np.round(np.vstack([corners, com]) * 1e6) + 0.0
    return points[np.lexsort(points.T)].tobytes() if len(points) < 200 else points.tobytes()


def rise_over(points: Array, com: Array) -> float:
    """m by which a centre of mass rises before a body tips over an edge of its support; negative outside of it.

    Args:
        points: (N, 2) m, of the support, seen from above.
        com: (3,) m, with its height over the support.
    """
    hull = shapely.convex_hull(shapely.multipoints(points))
    if hull.geom_type != "Polygon" or not shapely.contains_xy(hull, com[0], com[1]):
        return -1.0
    inside = float(hull.exterior.distance(shapely.Point(com[0], com[1])))
    return float(np.hypot(com[2], inside) - com[2])
