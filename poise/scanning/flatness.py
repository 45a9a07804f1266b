"""How flat views show their table: each sees it, and it is flat, so that it judges their poses and their scale."""

from collections.abc import Sequence

import numpy as np

from poise.scanning.frames import View
from poise.scanning.fusion import pixels_of
from poise.types import Array

_VIEWS = 24
PIXELS = 150
"""Of a view, that are asked for."""
FLAT = 1.2e-3
"""m: spread of the table about a plane below which the views agree about it, besides the noise of one view."""


def few_of(views: Sequence[View]) -> list[View]:
    """Some of the views, evenly."""
    return [views[i] for i in np.unique(np.linspace(0, len(views) - 1, _VIEWS).round().astype(int))] if views else []


def table_spread(views: Sequence[View], up: Array, farthest: float) -> float:
    """m, robust, of what several views see of the table about one plane; infinite when they show none."""
    few = few_of(views)
    points = [pixels_of(view, PIXELS, farthest) for view in few]
    return _about_plane(np.concatenate(points), up) if points else float("inf")


def _about_plane(points: Array, up: Array) -> float:
    """m: distance from the best level plane within which half of the points lie, as one sigma of noise."""
    best = float("inf")
    rng = np.random.default_rng(0)
    if len(points) < 100:
        return best
    few = points[rng.permutation(len(points))[:2000]]
    corners = few[rng.integers(len(few), size=(200, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 1e-9] / length[length > 1e-9, None]
    level = np.abs(normals @ up) > np.cos(np.deg2rad(20.0))
    if not level.any():
        return best
    off = np.abs(few @ normals[level].T - np.einsum("ni,ni->n", normals[level], corners[length > 1e-9][level, 0]))
    return 1.4826 * float(np.median(off, axis=0).min())


def noise_of_table(views: Sequence[View], up: Array, farthest: float) -> float:
    """m: the spread of the table in a single view, in the middle."""
    return float(np.median([table_spread([view], up, farthest) for view in few_of(views)])) if views else float("inf")
