"""Where a wall folds: creases across which a sheet goes on with its thickness are inside of a part.

Each turn of the wall of a cup folds the surface inwards, as the border between two parts does (the minima rule). But
behind a fold the other face of the wall turns outwards, while around a neck all of the surface turns inwards. What lies
opposite of a point is found from its pole, the largest of the balls through it, inside of the solid, that no other
point is in (Amenta and Bern 1999): circumscribed spheres of Delaunay tetrahedra are such balls.
"""

import numpy as np

from poise.geometry import lengths
from poise.shape.solid import Solid, circumspheres
from poise.shape.surface_graph import INWARDS, SurfaceGraph
from poise.types import Array, Indices, Mask

_LEAN = 0.5
"""Cosine between the inward normal and the way to the centre of a ball, from which on the ball is inside."""
_OPPOSITE, _ALIKE = -0.6, 1.5
"""Cosine between the normals of both faces of a sheet, at the most; and ratio of thicknesses that are the same."""
_NOWHERE = -1


def sheet_folds(carved: Solid, graph: SurfaceGraph) -> Mask:
    """(E,) which edges of a surface cross a crease where a sheet folds inwards.

    Args:
        carved: T tetrahedra, of a Delaunay triangulation.
        graph: of its surface, E edges.
    """
    inwards = graph.creases > INWARDS
    necks = np.zeros(len(carved.vertices), bool)
    necks[graph.edges[inwards]] = True
    opposite = opposite_points(carved, graph.normals, necks)
    there, points, normals = opposite != _NOWHERE, carved.vertices, graph.normals
    thickness = lengths(points - points[opposite])
    sheet = there & (np.einsum("ij,ij->i", normals, normals[opposite]) < _OPPOSITE)
    sheet &= ~necks[opposite]
    i, j = graph.edges.T
    alike = np.maximum(thickness[i], thickness[j]) < _ALIKE * np.minimum(thickness[i], thickness[j])
    return np.asarray(inwards & sheet[i] & sheet[j] & alike)


def opposite_points(carved: Solid, normals: Array, asked: Mask) -> Indices:
    """(V,) the point that the pole of a vertex touches on the other side; -1 where there is none, or it is not asked.

    Args:
        carved: T tetrahedra, of a Delaunay triangulation.
        normals: (V, 3) outward unit normals.
        asked: (V,) of which vertices.
    """
    points, tetrahedra = carved.vertices, carved.tetrahedra[asked[carved.tetrahedra].any(axis=1)]
    centres, radii = circumspheres(points[tetrahedra])
    vertex, owner = tetrahedra.ravel(), np.repeat(np.arange(len(tetrahedra)), 4)
    depth = np.einsum("ij,ij->i", points[vertex] - centres[owner], normals[vertex])
    kept = np.flatnonzero(asked[vertex] & (depth > _LEAN * radii[owner]))
    kept = kept[np.argsort(radii[owner[kept]], kind="stable")]
    pole = np.full(len(points), _NOWHERE)
    pole[vertex[kept]] = owner[kept]  # of several the largest, which is written last
    known = np.flatnonzero(pole != _NOWHERE)
    touched = tetrahedra[pole[known]]
    height = np.einsum("nki,ni->nk", points[touched] - points[known][:, None], normals[known])
    found = np.full(len(points), _NOWHERE)
    found[known] = np.take_along_axis(touched, height.argmin(axis=1)[:, None], axis=1)[:, 0]
    return found
