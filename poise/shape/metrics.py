"""How good a segmentation and a surface are: USE, GCE and the scaled Hausdorff distance (thesis section 3.2.4)."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from poise.types import Array


def undersegmentation_error(labels: ArrayLike, truth: ArrayLike) -> float:
    """USE: the share of points in segments that cross a border, counted on the smaller side of each crossing.

    Levinshtein et al. (2009) in the form of Neubert and Protzel (2012), which needs no tolerance: the sum over parts
    and the segments that touch them of min(points inside, points outside) / N, for labels and truth (N,) of the same
    points. 0 when no segment crosses a border.
    """
    table = _contingency(labels, truth)
    outside = table.sum(axis=1, keepdims=True) - table
    return float(np.minimum(table, outside).sum() / table.sum())


def global_consistency_error(labels: ArrayLike, truth: ArrayLike) -> float:
    """GCE of Martin et al. (2001): the lesser of the two mean local refinement errors; 0 when one refines the other."""
    table = _contingency(labels, truth)
    segments, parts = table.sum(axis=1, keepdims=True), table.sum(axis=0, keepdims=True)
    return float(min((table * (1 - table / segments)).sum(), (table * (1 - table / parts)).sum()) / table.sum())


def scaled_hausdorff(points: Array, reference: Array) -> float:
    """Symmetric Hausdorff distance of dense samples (N, 3), (M, 3), as a share of the reference's box diagonal."""
    return scaled_distances(points, reference)[0]


def scaled_distances(points: Array, reference: Array) -> tuple[float, float]:
    """The same, and the mean distance to the nearest point of the other set (the mean of both directions)."""
    diagonal = float(np.linalg.norm(np.ptp(reference, axis=0)))
    there, back = cKDTree(reference).query(points)[0], cKDTree(points).query(reference)[0]
    return max(there.max(), back.max()) / diagonal, (there.mean() + back.mean()) / 2 / diagonal


def _contingency(labels: ArrayLike, truth: ArrayLike) -> Array:
    """(S, P) number of points in segment s and part p."""
    segments = np.unique(np.asarray(labels), return_inverse=True)[1]
    parts = np.unique(np.asarray(truth), return_inverse=True)[1]
    table = np.zeros((segments.max() + 1, parts.max() + 1))
    np.add.at(table, (segments, parts), 1)
    return table
