"""Bounds on convex functions of the plane from a few of their values."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from poise.types import Array


def upper_planes(points: Array, values: Array) -> Array:
    """(F, 3) planes (a, b, c) such that max(a x + b y + c) bounds a convex function from above inside known points.

    The lower convex hull of the graph: the least function that convexity allows, with equality at the points. It is
    itself convex, so that no search for the triangle of a point is needed.

    Args:
        points: (M, 2) whose hull has area.
        values: (M,) of the function, or above it.
    """
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    height = float(values.max() - values.min())
    scale = height if height > 0 else 1.0
    base = float(values.min())
    graph = np.column_stack([(points - low) / size, (values - base) / scale])
    # A point far above makes a hull with volume even of values in one plane.
    apex = np.array([[0.5, 0.5, 10.0]])
    try:
        facets = ConvexHull(np.concatenate([graph, apex])).equations
    except QhullError:
        return np.array([[0.0, 0.0, float(values.max())]])
    facets = facets[facets[:, 2] < -1e-6]
    slopes = -facets[:, :2] / facets[:, 2:3]
    offsets = -facets[:, 3] / facets[:, 2]
    slopes = slopes / size * scale
    return np.column_stack([slopes, offsets * scale + base - slopes @ low])
