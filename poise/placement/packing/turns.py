"""The orientations in which an object is packed: on a face that it stands on, its sides along the container's."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull

from poise.assembly import RigidObject
from poise.assembly.contact import facet_curve
from poise.assembly.scene import Polyhedron
from poise.geometry import Pose, rotation_about, rotation_between
from poise.placement import rise_to_tip, steady_faces
from poise.placement.packing.cover import Cover, cover_of
from poise.types import Array

_FACES = 8
"""Faces that an object is put on, at most: the largest that it stands on."""
_LOOKED_AT = 200
"""Faces that are looked at for these."""
_CAUSES = ("not_stable", "orientation", "would_roll", "would_tip")
"""Causes for which a face is left out, in the order of the tests."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Turned:
    """An object in one orientation, the lowest corner of its bounds at the origin.

    Args:
        pose: of the object frame, in the container's axes.
        polyhedron: its surface.
        com: (3,) m.
    """

    pose: Pose
    polyhedron: Polyhedron
    com: Array

    @cached_property
    def corners(self) -> Array:
        """(V, 3) m."""
        return np.asarray(self.polyhedron.vertices @ self.pose.rotation.T + self.pose.translation)

    @cached_property
    def cover(self) -> Cover:
        """Boxes around it."""
        return cover_of(self.polyhedron, self.corners)

    @cached_property
    def size(self) -> Array:
        """(3,) m, of its bounds."""
        return np.asarray(np.ptp(self.corners, axis=0))


def turns_of(
    item: RigidObject,
    rise: float,
    allowed: Callable[[Array], bool] = lambda rotation: True,
    in_time: Callable[[], None] = lambda: None,
) -> tuple[list[Turned], str]:
    """The orientations of an object, the lowest first; when there are none, the cause, see `cause_of`.

    Args:
        item: at any pose.
        rise: m by which its centre of mass has to rise before it tips.
        allowed: whether a rotation (3, 3), from the object to the container's axes, is wanted; turning about the
            vertical does not matter.
        in_time: called for each face; raises when there is no time left.
    """
    polyhedron = item.shape.polyhedron
    com = np.asarray(item.shape.centroid if item.com is None else item.com)
    found: dict[bytes, Turned] = {}
    flat, causes = 0, {"not_stable"}
    for face in steady_faces(item.shape, com)[:_LOOKED_AT]:
        in_time()
        down = rotation_between(face.normal, -_UP)
        if not allowed(down):
            causes.add("orientation")
            continue
        if _is_round(polyhedron, face.normal):
            causes.add("would_roll")
            continue
        corners = polyhedron.vertices @ down.T
        lowest = corners[corners[:, 2] < corners[:, 2].min() + 1e-6]
        if rise_to_tip(lowest, down @ com, _UP) < rise:
            causes.add("would_tip")
            continue
        angle = _alignment(corners)
        for quarter in range(4):
            rotation = rotation_about(_UP, quarter * np.pi / 2 - angle) @ down
            low = (polyhedron.vertices @ rotation.T).min(axis=0)
            turned = Turned(Pose(rotation, -low), polyhedron, rotation @ com - low)
            found.setdefault(_same_place(turned.corners, turned.com), turned)
        flat += 1
        if flat == _FACES:
            break
    return sorted(found.values(), key=lambda turned: float(turned.size[2])), max(causes, key=_CAUSES.index)


def _is_round(polyhedron: Polyhedron, normal: Array) -> bool:
    """Whether the facets of a normal (3,) stand for a round side, on which the object would roll."""
    facets = np.flatnonzero(polyhedron.normals @ normal > 1 - 1e-9)
    return any(facet_curve(polyhedron, int(facet)) is not None for facet in facets)


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
