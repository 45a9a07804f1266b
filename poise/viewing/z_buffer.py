"""Triangles drawn into an image by depth: which one each pixel sees, and where. Exact for bodies of any shape."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.types import Array, Indices

NOTHING = -1


@dataclass(frozen=True, eq=False)
class PictureCamera:
    """A parallel view.

    Args:
        axes: (3, 3) rows: to the right, up, and towards the viewer.
        low: (2,) of the picture, m along right and up.
        scale: pixels per m.
        width, height: pixels.
    """

    axes: Array
    low: Array
    scale: float
    width: int
    height: int

    @classmethod
    def around(cls, points: Array, toward: Sequence[float], width: int, height: int, margin: float) -> "PictureCamera":
        """See all points (N, 3) from a direction, upright (z up), with a margin as a share of the picture."""
        view = np.asarray(toward, dtype=np.float64) / np.linalg.norm(toward)
        right = np.cross([0.0, 0.0, 1.0], view)
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(view, right), view])
        flat = points @ axes[:2].T
        low, high = flat.min(axis=0), flat.max(axis=0)
        room = (1 - 2 * margin) * np.array([width, height])
        scale = float((room / np.maximum(high - low, 1e-9)).min())
        return cls(axes, (low + high) / 2 - np.array([width, height]) / (2 * scale), scale, width, height)

    def project(self, points: ArrayLike) -> Array:
        """(N, 2) pixels from the lower left corner."""
        return np.asarray((np.asarray(points) @ self.axes[:2].T - self.low) * self.scale)


@dataclass(frozen=True, eq=False)
class Seen:
    """What each pixel sees, row 0 at the bottom.

    Args:
        triangle: (H, W) number, or `NOTHING`.
        points: (H, W, 3) m; NaN where nothing is seen.
    """

    triangle: Indices
    points: Array


def see(camera: PictureCamera, triangles: Array) -> Seen:
    """Draw triangles (T, 3, 3), m; of two at the same depth, the later one is seen."""
    depth = np.full((camera.height, camera.width), -np.inf)
    seen = np.full((camera.height, camera.width), NOTHING, dtype=np.int64)
    corners, depths = camera.project(triangles), triangles @ camera.axes[2]
    a, b, c = np.moveaxis(corners, 1, 0)
    areas = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    limit = np.array([camera.width, camera.height])
    lows = np.clip(np.floor(corners.min(axis=1)), 0, limit).astype(int)
    highs = np.clip(np.ceil(corners.max(axis=1)) + 1, 0, limit).astype(int)
    for number in np.flatnonzero((np.abs(areas) > 1e-9) & np.all(lows < highs, axis=1)).tolist():
        (left, bottom), (right, top) = lows[number].tolist(), highs[number].tolist()
        x, y = np.arange(left, right) + 0.5, (np.arange(bottom, top) + 0.5)[:, None]
        (ax, ay), (bx, by), (cx, cy) = corners[number].tolist()
        second = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / areas[number]
        third = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / areas[number]
        first = 1 - second - third
        here = first * depths[number, 0] + second * depths[number, 1] + third * depths[number, 2]
        nearer = (first >= 0) & (second >= 0) & (third >= 0) & (here >= depth[bottom:top, left:right])
        depth[bottom:top, left:right][nearer] = here[nearer]
        seen[bottom:top, left:right][nearer] = number
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    flat = np.stack([columns, rows], axis=-1) / camera.scale + camera.low
    points = np.concatenate([flat, np.where(seen >= 0, depth, np.nan)[..., None]], axis=-1) @ camera.axes
    return Seen(seen, points)
