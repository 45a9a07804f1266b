"""The points of a surface as a graph: which are neighbours on it, which way it faces there, where it has creases."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poise.geometry import cross, lengths, unique_rows
from poise.shape.solid import Solid
from poise.types import Array, Indices, Mask

INWARDS = 0.15
"""Fold of an edge from which on it counts as folded inwards: 32 degrees."""
_SLIT = 1.35
"""Fold inwards above which sides face each other across a slit, as in a bubble of the noise, and no two parts meet."""


@dataclass(frozen=True, eq=False)
class SurfaceGraph:
    """Neighbours along a surface, never across a gap between two parts.

    Args:
        edges: (E, 2) vertex numbers; a vertex that is not on the surface hangs on the nearest that is.
        normals: (V, 3) outward unit normals.
        creases: (E,) how far the surface folds between the ends of an edge, 0..2: positive where it folds inwards, as
            where two parts meet (the minima rule, thesis section 3.2.1), negative where it folds outwards; 0 in a slit.
    """

    edges: Indices
    normals: Array
    creases: Array


def surface_graph(solid: Solid) -> SurfaceGraph:
    """The graph of a solid's surface."""
    points = solid.vertices
    normals, on_surface = unit_normals(solid)
    edges = surface_edges(solid)
    inner, outer = np.flatnonzero(~on_surface), np.flatnonzero(on_surface)
    if len(inner):
        nearest = outer[cKDTree(points[outer]).query(points[inner])[1]]
        normals[inner] = normals[nearest]
        edges = np.concatenate([edges, np.stack([inner, nearest], axis=1)])
    creases = folds(points, normals, edges[:, 0], edges[:, 1])
    return SurfaceGraph(edges, normals, np.where(creases > _SLIT, 0.0, creases))


def surface_edges(solid: Solid) -> Indices:
    """(E, 2) vertex numbers of the edges of its triangles, each once, the lower first."""
    triangles, _ = solid.surface
    ends = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges = np.stack([ends.min(axis=1), ends.max(axis=1)], axis=1)
    return np.asarray(edges[unique_rows(edges)[0]])


def unit_normals(solid: Solid) -> tuple[Array, Mask]:
    """(V, 3) outward where a vertex is on the surface, zero elsewhere; and (V,) whether it is."""
    normals, _ = facing_of(solid)
    size = lengths(normals)
    on_surface = size > 0
    normals[on_surface] /= size[on_surface, None]
    return normals, on_surface


def facing_of(solid: Solid) -> tuple[Array, Array]:
    """Sums over the triangles around each vertex: (V, 3) of normals as long as twice the area, (V,) of the lengths."""
    triangles, _ = solid.surface
    a, b, c = (solid.vertices[triangles[:, k]] for k in range(3))
    normals = cross(b - a, c - a)
    columns = np.column_stack([normals, lengths(normals)])
    corners, count = triangles.ravel(), len(solid.vertices)
    sums = np.stack([np.bincount(corners, np.repeat(column, 3), count) for column in columns.T], axis=1)
    return sums[:, :3].astype(np.float64), sums[:, 3].astype(np.float64)


def folds(points: Array, normals: Array, i: Indices, j: Indices) -> Array:
    """(E,) 1 - n_i . n_j, negative where the surface folds outwards between points i and j."""
    fold = 1 - np.einsum("ij,ij->i", normals[i], normals[j])
    inwards = np.einsum("ij,ij->i", points[j] - points[i], normals[i] - normals[j]) > 0
    return np.asarray(np.where(inwards, fold, -fold))
