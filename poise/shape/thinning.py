"""Fewer points of a dense cloud, evenly spread."""

import numpy as np

from poise.types import Array, Indices

_ROUNDS = 12


def thin(points: Array, wanted: int) -> Indices:
    """Rows of (N, 3) points to keep, one per cube of a grid, about `wanted`; all but duplicates when there are fewer.

    Returns:
        (M,) increasing.
    """
    first = np.sort(np.unique(points, axis=0, return_index=True)[1])
    if len(first) <= wanted:
        return first
    low, extent = points.min(axis=0), np.ptp(points, axis=0).max()
    small, large = extent * 1e-6, extent
    best = first[:1]
    for _ in range(_ROUNDS):  # the count falls as the cubes grow: halve their ratio
        cube = np.sqrt(small * large)
        cells = np.floor((points[first] - low) / cube).astype(np.int64)
        off_middle = np.linalg.norm((points[first] - low) / cube - cells - 0.5, axis=1)
        order = np.lexsort((off_middle, *cells.T))
        new = np.append(True, np.any(np.diff(cells[order], axis=0) != 0, axis=1))
        if np.count_nonzero(new) > wanted:
            small = cube
        else:
            large, best = cube, np.sort(first[order[new]])
    return best
