"""Convex hulls of polyhedra, as polyhedra."""

from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull

from poise.assembly.scene.shapes import Polyhedron, merge_facets
from poise.geometry import cross


def hull_of(polyhedron: Polyhedron) -> Polyhedron:
    """A polyhedron if it is convex, else its convex hull."""
    return polyhedron if polyhedron.convex else _hull(polyhedron)


@lru_cache(maxsize=512)
def _hull(polyhedron: Polyhedron) -> Polyhedron:
    hull = ConvexHull(polyhedron.vertices)
    used, triangles = np.unique(hull.simplices, return_inverse=True)
    vertices, triangles = polyhedron.vertices[used], triangles.reshape(-1, 3).astype(np.int64)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", cross(b - a, c - a), hull.equations[:, :3]) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return merge_facets(vertices, triangles)
