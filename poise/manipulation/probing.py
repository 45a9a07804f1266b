"""Grasps of rough surfaces, such as those of scans: two fingers from above, on what their pads would touch."""

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from poise.assembly.scene import Polyhedron, Shape
from poise.geometry import plane_axes, unit
from poise.manipulation.hand import Grasp, Hand
from poise.types import Array

ROUGH_FACETS = 100
"""Facets from which on a shape is held for rough: its flat faces alone do not say where it can be grasped."""
_SAMPLES = 6000
_AZIMUTHS = 12
_STEP = 0.008
"""m between neighbouring places of the hand."""
_LOWEST = 0.006
"""m of the finger tips over the base, at least."""
_SKIN = 0.0015
"""m below the outermost point that counts as touched: more than the noise of a scan."""
_FLAT = np.cos(np.radians(15.0))
"""The mean normal of what is touched is this near to the closing direction; friction holds more."""
_ASKEW = 0.25
"""Share of the width by which the touched places may be apart across the closing direction."""
_FEWEST = 12
"""Samples that a pad touches."""
_MOST = 60
"""Grasps, those that touch most."""


def probed_grasps(shape: Shape, hand: Hand, up: Array) -> tuple[Grasp, ...]:
    """Grasps from above of a shape with many facets; none of one with few. Room for the hand is not checked.

    Args:
        shape: in the object frame.
        hand: whose pads touch it.
        up: (3,) away from gravity, in the object frame.
    """
    polyhedron = shape.polyhedron
    if len(polyhedron.normals) < ROUGH_FACETS:
        return ()
    points, normals = _sampled(polyhedron)
    approach = -unit(up)
    level = plane_axes(-approach)
    found: list[tuple[int, Grasp]] = []
    for angle in np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS:
        closing = np.cos(angle) * level[0] + np.sin(angle) * level[1]
        rotation = np.stack([np.cross(closing, approach), closing, approach], axis=1)
        found.extend(_along(points @ rotation, normals @ rotation, rotation, hand))
    found.sort(key=lambda entry: -entry[0])
    return tuple(grasp for _, grasp in found[:_MOST])


def _along(points: Array, normals: Array, rotation: Array, hand: Hand) -> Iterator[tuple[int, Grasp]]:
    """Grasps with one closing direction, and how many samples they touch; all in tool axes, z is the approach."""
    wide, _, long = hand.finger
    low, high = points.min(axis=0), points.max(axis=0)
    for tip in np.arange(high[2] - _LOWEST, low[2] + _STEP, -_STEP):
        layer = (points[:, 2] <= tip) & (points[:, 2] >= tip - long)
        for x in np.arange(low[0] + _STEP / 2, high[0], _STEP):
            rows = np.flatnonzero(layer & (np.abs(points[:, 0] - x) <= wide / 2))
            if len(rows) < 2 * _FEWEST:
                continue
            y = points[rows, 1]
            ends = y.min(), y.max()
            width = float(ends[1] - ends[0])
            touched = [rows[y <= ends[0] + _SKIN], rows[y >= ends[1] - _SKIN]]
            if width > hand.widest or min(map(len, touched)) < _FEWEST:
                continue
            facing = [sign * unit(normals[side].mean(axis=0))[1] for sign, side in zip((-1, 1), touched, strict=True)]
            middles = [points[side].mean(axis=0) for side in touched]
            apart = np.delete(middles[1] - middles[0], 1)
            if min(facing) < _FLAT or np.linalg.norm(apart) > _ASKEW * width:
                continue
            place = rotation @ np.array([x, np.mean(ends), tip])
            yield min(map(len, touched)), Grasp(pin.SE3(rotation, place), width)


def _sampled(polyhedron: Polyhedron) -> tuple[Array, Array]:
    """(N, 3) m points spread evenly over a surface, and their outward normals."""
    corners = polyhedron.vertices[polyhedron.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(across, axis=1)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(areas), _SAMPLES, p=areas / areas.sum())
    u, v = rng.random((2, _SAMPLES, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = np.moveaxis(corners[chosen], 1, 0)
    return a + u * (b - a) + v * (c - a), across[chosen] / areas[chosen, None]
