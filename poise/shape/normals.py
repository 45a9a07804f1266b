"""Unit normals of surface points, without a side: the direction in which a point's neighbours spread least."""

import numpy as np
from scipy.spatial import cKDTree

from poise.shape.solid import Array, Indices

NEIGHBOURS = 10


def neighbours_of(points: Array, count: int = NEIGHBOURS) -> Indices:
    """(N, count) numbers of the nearest other points of each of (N, 3)."""
    count = min(count, len(points) - 1)
    return np.asarray(cKDTree(points).query(points, k=count + 1)[1][:, 1:])


def estimate_normals(points: Array, neighbours: Indices) -> Array:
    """(N, 3) unit normals of points (N, 3) m, from their neighbours (N, K); their sign means nothing."""
    around = np.concatenate([points[:, None], points[neighbours]], axis=1)
    around = around - around.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))[1][:, :, 0])
