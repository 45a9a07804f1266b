"""Convex hulls as the outermost points in fixed directions: their unions cost a comparison, and their volumes a sum.

The directions are the corners of triangles around a sphere. With each direction replaced by the point that is outermost
in it, the triangles lie on the hull of these points but for diagonals of its faces, and their volume is that of the
hull, up to what is beyond its corners in other directions.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from poise.kernels import COMPILED, hulls_of_clusters
from poise.types import Array, Indices


def _sphere(pairs: int) -> tuple[Array, Indices]:
    """(2 pairs, 3) unit vectors, evenly spread, each with its opposite; and (T, 3) the triangles between them."""
    step = np.arange(pairs) + 0.5
    down, around = np.arccos(1 - step / pairs), np.pi * (1 + 5**0.5) * step
    half = np.stack([np.cos(around) * np.sin(down), np.sin(around) * np.sin(down), np.cos(down)], axis=1)
    directions = np.concatenate([half, -half])
    triangles = ConvexHull(directions).simplices.astype(np.int64)
    inwards = np.linalg.det(directions[triangles]) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return directions, triangles


_DIRECTIONS, TRIANGLES = _sphere(120)
_CORNERS = np.ascontiguousarray(TRIANGLES.T)


class Hulls(NamedTuple):
    """Hulls of K sets of points.

    Args:
        reach: (K, D) m along each direction.
        points: (K, 3, D) m, that are the outermost in each direction.
    """

    reach: Array
    points: Array

    @classmethod
    def of_clusters(cls, points: Array, tetrahedra: Indices, clusters: Indices, count: int) -> "Hulls":
        """Hulls of the tetrahedra (T, 4), among points (N, 3) m, in each of the clusters (T,), none empty."""
        if COMPILED:
            return cls(*hulls_of_clusters(points, tetrahedra, clusters, count, _DIRECTIONS))
        cluster, corner = np.divmod(np.unique(clusters[:, None] * len(points) + tetrahedra), len(points))
        return cls.of(np.split(points[corner], np.searchsorted(cluster, np.arange(1, count))))

    @classmethod
    def of(cls, sets: list[Array]) -> "Hulls":
        """Hulls of sets of points (N, 3) m, none empty."""
        reach, points = np.empty((len(sets), len(_DIRECTIONS))), np.empty((len(sets), 3, len(_DIRECTIONS)))
        for number, one in enumerate(sets):
            along = _DIRECTIONS @ one.T
            first = along.argmax(axis=1)
            reach[number], points[number] = along[np.arange(len(first)), first], one[first].T
        return cls(reach, points)

    def with_each(self, others: "Hulls") -> "Hulls":
        """The hulls of one set, or K, together with K others."""
        own = self.reach >= others.reach
        reach = np.where(own, self.reach, others.reach)
        return Hulls(reach, np.where(own[:, None], self.points, others.points))

    @property
    def volumes(self) -> Array:
        """(K,) m3; the points should be near the origin."""
        (a, d, g), (b, e, h), (c, f, i) = (self.points.take(corner, axis=2).swapaxes(0, 1) for corner in _CORNERS)
        return np.asarray((a * (e * i - f * h) - d * (b * i - c * h) + g * (b * f - c * e)).sum(axis=-1) / 6)
