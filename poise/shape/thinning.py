"""Fewer points of a dense cloud, evenly spread."""

import numpy as np

from poise.geometry import unique_rows
from poise.shape.spacing import Spacing, spacing_of
from poise.types import Array, Indices, Mask

_ROUNDS = 12
_UNEVEN = 3.5
"""Spacing on half of the surface, over that of half of the points, from which on these are uneven."""
_FLAT = 0.05
"""Standard deviation of the points in a cube from their plane, over the edge of the cube, up to which they are flat."""


def thin(points: Array, wanted: int) -> Indices:
    """Rows of (N, 3) points to keep, one per cube of a grid, about `wanted`; all but duplicates when there are fewer.

    That nearest to the middle is kept, for even spacing; any one where a cube holds more than a flat piece of surface:
    those nearest to the middles may all be of one face of a plate.

    Returns:
        (M,) increasing.
    """
    first = np.sort(unique_rows(points)[0])
    if len(first) <= wanted:
        return first
    off = points[first] - points.min(axis=0)
    extent = off.max()
    small, large = extent * 1e-6, extent
    kept = large
    for _ in range(_ROUNDS):  # the count falls as the cubes grow: halve their ratio
        cube = np.sqrt(small * large)
        cells = np.sort(_cells(off, cube))
        if 1 + np.count_nonzero(np.diff(cells)) > wanted:
            small = cube
        else:
            large = kept = cube
    cells = _cells(off, kept)
    at = off / kept
    off_middle = np.linalg.norm(at - np.floor(at) - 0.5, axis=1)
    chance = np.random.default_rng(0).random(len(first))
    order = np.lexsort((np.where(_thick(at, cells), chance, off_middle), cells))
    return np.sort(first[order[np.append(True, np.diff(cells[order]) != 0)]])


def _thick(points: Array, cells: Indices) -> Mask:
    """(N,) whether the points in the same cell, of edge one, leave a plane by more than `_FLAT`."""
    cell = np.unique(cells, return_inverse=True)[1]
    count = np.bincount(cell)
    mean = np.column_stack([np.bincount(cell, column) for column in points.T]) / count[:, None]
    centred = points - mean[cell]
    products = (centred[:, :, None] * centred[:, None, :]).reshape(-1, 9)
    covariance = np.column_stack([np.bincount(cell, column) for column in products.T]) / count[:, None]
    least = np.linalg.eigvalsh(covariance.reshape(-1, 3, 3))[:, 0]
    return np.asarray(least > _FLAT**2)[cell]


def evened(points: Array) -> tuple[Indices, Spacing]:
    """Rows of (N, 3) points to keep where most are on a small share of the surface, as in a close view; else all.

    Half of the surface, at least, is left as dense as it is.

    Returns:
        (M,) increasing, and the spacing of the points that are kept.
    """
    spacing = spacing_of(points)
    order = np.argsort(spacing.around)
    covered = np.cumsum(spacing.around[order] ** 2)  # each point stands for the square of its spacing
    usual = spacing.around[order[np.searchsorted(covered, covered[-1] / 2)]]
    if usual <= _UNEVEN * np.median(spacing.around):
        return np.arange(len(points)), spacing
    rows = thin(points, int(np.sum(np.minimum(spacing.around / usual, 1.0) ** 2)))
    return rows, spacing_of(points[rows])


def _cells(points: Array, cube: float) -> Indices:
    """(N,) one number for each cube of a grid, of points (N, 3) from its corner."""
    cells = np.floor(points / cube).astype(np.int64)
    size = cells.max(axis=0) + 1
    return np.asarray((cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2])
