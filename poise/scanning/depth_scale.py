"""Depth that is too long or too short by a share, found from the table, whose height all views must see alike.

A camera at height h above a table whose depth is too long by a share b sees the table at -b h. Views from different
heights therefore show b, which the other errors of a sweep do not imitate: a plane that is tilted or too high, and a
camera that is turned or shifted on the hand, are fitted along. A camera that sits farther back along its axis acts
alike, as long as it keeps its distance; then the correction is right at that distance, which is where the object is.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from poise.scanning.camera import rotated
from poise.scanning.frames import View
from poise.scanning.fusion import pixels_of
from poise.scanning.looking import each
from poise.scanning.shared_errors import sandwich, variance_of
from poise.scanning.support import NEAR, Plane
from poise.types import Array

_LEAST, _MOST = 0.003, 0.04
"""Shares between which depth is corrected: less is within the specification, more is another unit or another camera."""
_SURE = 3.5
"""Standard errors that a share has to be away from none."""
_FEWEST = 24
"""Views that are needed."""
_PRIOR = 1 / np.array([1.0, 1.0, 1.0, 1.0, *[np.deg2rad(0.5)] * 3, 2e-3, 2e-3]) ** 2
"""Of the plane's height, m, and slopes, the share, and the camera's turn, rad, and shift across its axis, m, on the
hand: one sigma."""
_PIXELS = 800
"""Of a view, that are asked for."""
_SHARE = 3
"""Number of the unknown that is wanted."""
_ROUNDS = 4
_FINEST, _REACH = 1e-4, 3.0
"""m, of a pixel's noise, and how many times it a pixel of the table may be off."""


def depth_scale(views: Sequence[View], plane: Plane, farthest: float) -> float:
    """The share by which depth is too long (negative: too short); 0 where the views do not show one for sure.

    Args:
        views: of a sweep.
        plane: the table.
        farthest: m from the camera up to which it is looked at.
    """
    if len(views) < _FEWEST:
        return 0.0
    rows = each(views, lambda view: _rows(view, plane, farthest))
    owners = np.repeat(np.arange(len(rows)), [len(heights) for _, heights in rows])
    design, heights = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    unknowns: Array = np.zeros(len(_PRIOR))
    weights: Array = np.ones(len(heights))
    for _ in range(_ROUNDS):
        left = heights - design @ unknowns
        # Poses that are off by themselves move all pixels of a view: these do not count as so many measurements.
        precise = weights / variance_of(left, weights, owners, len(rows), _PIXELS)
        system = (design * precise[:, None]).T @ design + np.diag(_PRIOR)
        unknowns = np.asarray(np.linalg.solve(system, design.T @ (precise * heights)), np.float64)
        left = heights - design @ unknowns
        reach = _REACH * max(1.4826 * float(np.median(np.abs(left))), _FINEST)
        weights = np.maximum(1 - (left / reach) ** 2, 0) ** 2  # what floats at edges of things is above the table
    covariance = sandwich(system, design * (precise * left)[:, None], owners, len(rows))
    share, sigma = float(unknowns[_SHARE]), float(np.sqrt(covariance[_SHARE, _SHARE]))
    return share if abs(share) > max(_LEAST, _SURE * sigma) and abs(share) < _MOST else 0.0


def rescaled(views: Sequence[View], share: float) -> list[View]:
    """The views with depth that is no longer too long by a share."""
    factor = np.float32(1 / (1 + share))

    def of_view(view: View) -> View:
        return replace(view, frame=replace(view.frame, depth=view.frame.depth * factor))

    return each(views, of_view)


def _rows(view: View, plane: Plane, farthest: float) -> tuple[Array, Array]:
    """(N, 9) how the heights of a view's pixels of the table grow with each unknown, and (N,) m heights."""
    points = pixels_of(view, _PIXELS, farthest).astype(np.float64)
    placed = plane.placed(points)
    table = np.abs(placed[:, 2]) < NEAR
    points, placed = points[table], placed[table]
    there = rotated(points - view.translation_world_camera, view.rotation_world_camera.T)
    normal = view.rotation_world_camera.T @ plane.normal
    turned = np.cross(there, normal)  # of a small turn w: n . (w x p) = w . (p x n)
    across = np.tile(normal[:2], (len(points), 1))
    middle = placed[:, :2].mean(axis=0) if len(placed) else np.zeros(2)
    return np.column_stack([np.ones(len(points)), placed[:, :2] - middle, there @ normal, turned, across]), placed[:, 2]
