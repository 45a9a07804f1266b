"""Whether forces at some points could carry an object at all: a cheap test before the costly ones."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from poise.assembly import Analysis, RigidObject
from poise.geometry import Pose, cross, plane_axes
from poise.placement.matching import SupportPoint
from poise.types import Array

BALANCE_ROUNDING = 1e-6
"""Of the object's weight: what is left over by less is rounding."""
_ON_PLANE = 1e-4
"""m."""
_ON_LINE = 1e-3
"""Relative to the object's size: on points this near to a line it may roll."""


def unbalanced_share(points: Array, normals: Array, friction: Array, gravity: Array, size: float) -> float:
    """How much of a unit weight, force and moment, presses at some points cannot balance at least.

    Thesis section 5.5.4 asks the forces of a QR (eq. 5.6-5.8) first; these may pull where others need not. Here the
    forces press, within pyramids around the friction cones: what they leave over, nothing within the cones balances.

    Args:
        points: (K, 3) m, from the centre of mass.
        normals: (K, 3) into the object.
        friction: (K,).
        gravity: (3,) unit vector.
        size: m, that makes forces of moments.
    """
    slides = np.sqrt(2) * friction[:, None, None] * plane_axes(normals)
    forces = normals[:, None] + np.concatenate([slides, -slides], axis=1)
    moments = cross(points[:, None], forces) / size
    columns = np.concatenate([forces, moments], axis=2).reshape(-1, 6)
    return float(nnls(columns.T, np.append(-gravity, np.zeros(3)))[1])


def unbalanced_weight(analysis: Analysis, item: RigidObject) -> float:
    """How much of an object's weight its contacts in an assembly cannot balance; see `unbalanced_share`."""
    place = analysis.assembly.index[item.id]
    touching = [i for i in analysis.structure.interfaces if place in (i.first, i.second)]
    if not touching:
        return 1.0
    counts = [len(i.points) for i in touching]
    normals = np.array([i.normal if place == i.second else -i.normal for i in touching])
    gravity = np.asarray(analysis.assembly.gravity)
    return unbalanced_share(
        np.concatenate([i.points for i in touching]) - item.com_in_world,
        np.repeat(normals, counts, axis=0),
        np.repeat([i.friction for i in touching], counts),
        gravity / np.linalg.norm(gravity),
        float(np.linalg.norm(np.ptp(item.vertices, axis=0))),
    )


@dataclass(frozen=True, eq=False)
class SupportCheck:
    """Whether an object at a pose lies on planes of the scene, as if these had no end, and they could carry it.

    Args:
        vertices: (V, 3) m, in the object frame.
        com: (3,) m.
        convex: all of it has to be above the planes; other objects may reach around.
        friction: the largest there is.
        gravity: (3,) unit vector.
    """

    vertices: Array
    com: Array
    convex: bool
    friction: float
    gravity: Array

    def allows(self, pose: Pose, contacts: tuple[SupportPoint, ...]) -> bool:
        """Whether the object could rest on planes (a point and a normal each); a cheap test before the full ones."""
        corners, com = pose.apply(self.vertices), pose.apply(self.com)
        points, normals = [], []
        for contact in contacts:
            heights = (corners - contact.point) @ contact.normal
            if self.convex and heights.min() < -_ON_PLANE:
                return False
            on = corners[np.abs(heights) < _ON_PLANE]
            points.append(on - com)
            normals.append(np.broadcast_to(contact.normal, on.shape))
        found = np.concatenate(points)
        size = float(np.linalg.norm(np.ptp(corners, axis=0)))
        if len(found) < 3 or np.linalg.svd(found - found.mean(axis=0), compute_uv=False)[1] < _ON_LINE * size:
            return False
        friction = np.full(len(found), self.friction)
        return unbalanced_share(found, np.concatenate(normals), friction, self.gravity, size) < BALANCE_ROUNDING
