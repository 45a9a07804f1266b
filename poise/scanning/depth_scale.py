"""Depth that is too long or too short by a share, found from the table, whose height all views must see alike.

A camera at height h above a table whose depth is too long by a share b sees the table at -b h. Views from different
heights therefore show b, which the other errors of a sweep do not imitate: a plane that is tilted or too high, and a
camera that is turned or shifted on the hand, are fitted along. A camera that sits farther back along its axis acts
alike, as long as it keeps its distance; then the correction is right at that distance, which is where the object is.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from poise.scanning.camera import rotated
from poise.scanning.frames import View
from poise.scanning.fusion import pixels_of
from poise.scanning.looking import each
from poise.scanning.support import NEAR, Plane
from poise.types import Array

_LEAST, _MOST = 0.003, 0.04
"""Shares between which depth is corrected: less is within the specification, more is another unit or another camera."""
_SURE = 3.5
"""Standard errors that a share has to be away from none."""
_FEWEST, _GROUPS = 24, 12
"""Views that are needed, and groups of views in a row, whose poses may err alike."""
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
    bounds = np.linspace(0, len(rows), _GROUPS + 1).round().astype(int)
    groups = [_stacked(rows[first:last]) for first, last in pairwise(bounds)]
    design, heights = _stacked(groups)
    unknowns: Array = np.zeros(len(_PRIOR))
    weights: Array = np.ones(len(heights))
    for _ in range(_ROUNDS):
        noise = max(1.4826 * float(np.median(np.abs(heights - design @ unknowns))), _FINEST)
        system = (design * weights[:, None]).T @ design / noise**2 + np.diag(_PRIOR)
        unknowns = np.asarray(np.linalg.solve(system, design.T @ (weights * heights) / noise**2), np.float64)
        reach = _REACH * noise  # what floats at the edges of other things is above the table
        weights = _biweight((heights - design @ unknowns) / reach)
    scores = np.array([of.T @ (_biweight((at - of @ unknowns) / reach) * (at - of @ unknowns)) for of, at in groups])
    inverse = np.linalg.inv(system)
    meat = scores.T @ scores / noise**4  # groups of views err alike (Liang and Zeger 1986)
    sigma = float(np.sqrt((inverse @ meat @ inverse + inverse)[_SHARE, _SHARE]))
    share = float(unknowns[_SHARE])
    return share if abs(share) > max(_LEAST, _SURE * sigma) and abs(share) < _MOST else 0.0


def rescaled(views: Sequence[View], share: float) -> list[View]:
    """The views with depth that is no longer too long by a share."""
    factor = np.float32(1 / (1 + share))

    def of_view(view: View) -> View:
        return replace(view, frame=replace(view.frame, depth=view.frame.depth * factor))

    return each(views, of_view)


def _biweight(off: Array) -> Array:
    return np.asarray(np.maximum(1 - off**2, 0) ** 2)


def _stacked(rows: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    return np.concatenate([of for of, _ in rows]), np.concatenate([at for _, at in rows])


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
