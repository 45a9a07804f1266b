"""The nearest of points, in a grid where compiled kernels are there, and in a tree where they are not."""

import numpy as np
from scipy.spatial import cKDTree

from poise.kernels import COMPILED, nearest_of
from poise.types import Array, Indices

_CUBE = 2.0
"""Spacings of the points, about, in the grid."""


def nearest(points: Array, places: Array, count: int) -> tuple[Array, Indices]:
    """(M, K) m and (M, K) numbers of the K nearest of points (N, 3), on a surface, to places (M, 3) at or near them."""
    if not COMPILED:
        found = cKDTree(points).query(places, k=np.arange(1, count + 1))
        return np.asarray(found[0]), np.asarray(found[1])
    a, b, c = np.ptp(points, axis=0)
    return nearest_of(points, places, count, _CUBE * np.sqrt(2 * (a * b + b * c + c * a) / len(points)))
