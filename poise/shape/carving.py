"""From surface points to a solid: a ball that cannot pass between them carves everything it reaches away.

The Delaunay tetrahedra of the points are the stone. A ball of some radius comes from far away and moves from one
tetrahedron into the next when it fits through the triangle between them and into the tetrahedron itself; what it never
reaches is the object (the sculpture of Boissonnat 1984, with the ball of Edelsbrunner and Mücke's alpha shapes 1994).
No normals are needed, the answer is always closed, and plates thinner than the spacing of their points stay whole.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import Delaunay, QhullError, cKDTree

from poise.errors import ErrorCode, InputError
from poise.shape.solid import FACES, Solid, tetrahedron_volumes
from poise.types import Array, Indices

_BALL = 2.4
"""Radius of the ball in spacings of the points: it passes no hole of random sampling, yet enters what is concave."""
_SPREAD = (2.1, 3.0)
"""Radii, in spacings, between which the volume is taken as uncertain."""
_NEIGHBOURS = 6
_LEAK = 0.6
"""A ball that finds less than this share of the volume which a larger ball leaves has found a hole in the sampling."""
_LEAK_BALLS = (2.8, 3.2, 4.0)
_FEWEST_POINTS = 20
_TINY = 1e-30


def spacing_of(points: Array) -> float:
    """Typical distance between neighbouring points (N, 3): the median of the mean over six neighbours, m."""
    distances = cKDTree(points).query(points, k=_NEIGHBOURS + 1)[0]
    return float(np.median(distances[:, 1:].mean(axis=1)))


def carve(points: Array, spacing: float | None = None) -> Solid:
    """The solid whose surface the points lie on.

    Args:
        points: (N, 3) m, on the whole surface, in any order.
        spacing: m between neighbours; None: as measured.

    Raises:
        InputError: SCAN_INCOMPLETE for too few points, MESH_INVALID when they enclose no volume.
    """
    if len(points) < _FEWEST_POINTS:
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE, f"cloud: {len(points)} points are too few for a surface; scan it again"
        )
    spacing = spacing_of(points) if spacing is None else spacing
    try:
        delaunay = Delaunay(points - points.mean(axis=0))
    except QhullError as error:
        raise InputError(
            ErrorCode.MESH_INVALID, "cloud: its points lie in one plane or on one line, which has no volume"
        ) from error
    tetrahedra, neighbours = delaunay.simplices.astype(np.int64), delaunay.neighbors.astype(np.int64)
    left_handed = tetrahedron_volumes(points[tetrahedra]) < 0
    for rows in (tetrahedra, neighbours):
        rows[left_handed, :2] = rows[left_handed, 1::-1]
    corners = points[tetrahedra]
    volumes = tetrahedron_volumes(corners)
    reach = _reach(corners, neighbours) / spacing

    def volume(ball: float) -> float:
        return float(volumes[reach <= ball].sum())

    ball = max([_BALL, *(larger for larger in _LEAK_BALLS if volume(_BALL) < _LEAK * volume(larger))])
    kept = np.flatnonzero((reach <= ball) & (volumes > 0))
    if not len(kept):
        raise InputError(ErrorCode.MESH_INVALID, "cloud: the points enclose no volume; scan all sides of the object")
    low, high = (volume(ball / _BALL * limit) for limit in _SPREAD)
    number = np.full(len(tetrahedra) + 1, -1)
    number[kept] = np.arange(len(kept))
    return Solid(points, tetrahedra[kept], number[neighbours[kept]], volume_std=(high - low) / 2)


def _reach(corners: Array, neighbours: Indices) -> Array:
    """(T,) radius of the largest ball, m, that comes into each tetrahedron from outside.

    The best way in is the path in the widest spanning tree, so that one tree answers for balls of every radius.
    """
    n_tetrahedra = len(corners)
    inner = np.repeat(np.arange(n_tetrahedra), 4)
    outer = np.where(neighbours.ravel() < 0, n_tetrahedra, neighbours.ravel())
    own = np.append(_circumradius_of_tetrahedra(corners), np.inf)
    gate = _circumradius_of_triangles(corners[:, FACES].reshape(-1, 3, 3))
    width = np.minimum(np.minimum(gate, own[inner]), own[outer])
    once = inner < outer
    inner, outer, width = inner[once], outer[once], width[once]
    widest = np.lexsort((-width, outer, inner))  # a tetrahedron at a corner of the hull has several ways out
    inner, outer, width = inner[widest], outer[widest], width[widest]
    first = np.append(True, (np.diff(inner) != 0) | (np.diff(outer) != 0))
    narrowness = coo_array(
        (1 / np.maximum(width[first], _TINY), (inner[first], outer[first])), shape=(n_tetrahedra + 1,) * 2
    )
    tree = minimum_spanning_tree(narrowness.tocsr())
    order, parent = breadth_first_order(tree, n_tetrahedra, directed=False)
    both = tree + tree.T
    to_parent = np.full(n_tetrahedra + 1, np.inf)
    to_parent[order[1:]] = 1 / np.asarray(both[order[1:], parent[order[1:]]]).ravel()
    reach, parents = to_parent.tolist(), parent.tolist()
    for tetrahedron in order[1:].tolist():
        reach[tetrahedron] = min(reach[tetrahedron], reach[parents[tetrahedron]])
    return np.array(reach[:n_tetrahedra])


def _circumradius_of_triangles(corners: Array) -> Array:
    """(F,) m, of triangles (F, 3, 3)."""
    a, b, c = (np.linalg.norm(corners[:, i] - corners[:, j], axis=1) for i, j in ((1, 2), (0, 2), (0, 1)))
    doubled_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return np.asarray(a * b * c / np.maximum(2 * doubled_area, _TINY))


def _circumradius_of_tetrahedra(corners: Array) -> Array:
    """(T,) m, of tetrahedra (T, 4, 3); flat ones count as huge."""
    edges = corners[:, 1:] - corners[:, :1]
    squares = np.einsum("tij,tij->ti", edges, edges)
    normal = (
        squares[:, :1] * np.cross(edges[:, 1], edges[:, 2])
        + squares[:, 1:2] * np.cross(edges[:, 2], edges[:, 0])
        + squares[:, 2:] * np.cross(edges[:, 0], edges[:, 1])
    )
    six_volumes = np.einsum("ij,ij->i", edges[:, 0], np.cross(edges[:, 1], edges[:, 2]))
    return np.asarray(np.linalg.norm(normal, axis=1) / np.maximum(2 * np.abs(six_volumes), _TINY))
