"""From surface points to a solid: a ball that cannot pass between them carves everything it reaches away.

The Delaunay tetrahedra of the points are the stone. A ball of some radius comes from far away and moves from one
tetrahedron into the next when it fits through the triangle between them and into the tetrahedron itself; what it never
reaches is the object (the sculpture of Boissonnat 1984, with the ball of Edelsbrunner and Mücke's alpha shapes 1994).
No normals are needed, the answer is always closed, and plates thinner than the spacing of their points stay whole.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import Delaunay, QhullError

from poise.errors import ErrorCode, InputError
from poise.geometry import cross, lengths, row_order
from poise.kernels import COMPILED, tetrahedra_of, ways_in
from poise.shape.gaps import is_cavity
from poise.shape.missing import bare_share
from poise.shape.pockets import Entrances, depths_below, pockets
from poise.shape.solid import FACES, Solid, circumspheres, tetrahedron_volumes
from poise.shape.spacing import Spacing, spacing_of
from poise.types import Array, Indices, Mask

_BALL = 2.4
"""Radius of the ball in spacings of the points: it passes no hole of random sampling, yet enters what is concave."""
_SPREAD = (2.1, 3.0)
"""Radii, in spacings, between which the volume is taken as uncertain."""
_LEAK, _SHEETS = 0.6, 0.035
"""A ball that finds less than this share of the volume which a larger ball leaves has found a hole in the sampling, or
an opening, such as that of a cup. Through a hole it leaves sheets, whose two sides are the same points: in scans of a
hammer the points on sheets are 0.06 to 0.12 of all, in cups at most 0.02."""
_LEAK_BALLS = (2.8, 3.2, 4.0)
_DOUBT, _CUP_DOUBT, _POCKET_DOUBT = 0.75, 0.2, 0.9
"""Shares of the volume behind an opening, behind that of a cup, and in pockets, that are counted as one sigma."""
_WALLS, _BEHIND = 0.3, 0.5
"""Share of the points that lie so many spacings inside of what the largest ball leaves, from which on they are walls of
a cup: 0.3 to 0.5 of cups of few points, at most 0.28 of solid objects with a hole in the sampling."""
_LARGEST_BALL = 4.0
"""Spacings, of a ball that needs no leave."""
_FEWEST_POINTS = 20
_PLANE_LIKE, _FLAT = 1e-6, 1e-8
"""Thickness over length below which all points are in a plane; and those of a tetrahedron, for each squared spacing."""
_TINY = 1e-30


def carve(
    points: Array, spacing: Spacing | None = None, noise: float | None = None, normals: Array | None = None
) -> Solid:
    """The solid whose surface the points lie on.

    Args:
        points: (N, 3) m, on the whole surface, in any order.
        spacing: between neighbours; None: as measured.
        noise: m, one sigma of the points, from which pockets follow (see `pockets`); None: there are none.
        normals: (N, 3) outward unit normals, where they were measured.

    Raises:
        InputError: SCAN_INCOMPLETE for too few points, MESH_INVALID when they enclose no volume.
    """
    return Stone(points, spacing).carve(noise, normals)


class Stone:
    """The Delaunay tetrahedra of points, and how large a ball comes into each; it may be carved several times.

    Args:
        points, spacing: as of `carve`.

    Raises:
        InputError: as `carve`.
    """

    def __init__(self, points: Array, spacing: Spacing | None = None) -> None:
        if len(points) < _FEWEST_POINTS:
            raise InputError(
                ErrorCode.SCAN_INCOMPLETE, f"cloud: {len(points)} points are too few for a surface; scan it again"
            )
        self.spacing = spacing_of(points) if spacing is None else spacing
        try:
            tetrahedra, neighbours = _delaunay(points - points.mean(axis=0))
        except (QhullError, np.linalg.LinAlgError) as error:
            raise InputError(
                ErrorCode.MESH_INVALID, "cloud: its points lie in one plane or on one line, which has no volume"
            ) from error
        self._points, self._tetrahedra, self._neighbours = points, tetrahedra, neighbours
        self._whole = Solid(points, tetrahedra, neighbours)
        self._volumes = np.abs(tetrahedron_volumes(points[tetrahedra]))  # flat ones may seem left-handed
        self._flat = _FLAT * float(np.ptp(points, axis=0).max()) * self.spacing.usual**2
        reach, order, parents = _reach(points, self.spacing.coarseness, tetrahedra, neighbours)
        self._tree = reach / self.spacing.usual, order, parents

    def carve(self, noise: float | None = None, normals: Array | None = None) -> Solid:
        """The solid; arguments and errors as of the function `carve`."""
        reach = self._tree[0]
        small_ball, largest_ball = self._volume(_BALL), self._volume(_LEAK_BALLS[-1])
        larger = [each for each in _LEAK_BALLS if small_ball < _LEAK * self._volume(each)]
        opening = bool(larger) and self._opens(normals)
        ball = _BALL if opening else max([_BALL, *larger])
        cup = opening and self._has_walls_inside()
        inside = self._peeled(reach <= ball)
        if noise is not None:
            inside = self._peeled(reach <= (ball if cup else _LARGEST_BALL))
            ways = Entrances(self._points, self.spacing.usual, self._tetrahedra, self._neighbours, self._tree)
            inside = self._peeled(inside & ~pockets(ways, inside, ball, noise, normals))
        found = self._whole.only(inside)
        if not len(found.tetrahedra):
            raise InputError(
                ErrorCode.MESH_INVALID, "cloud: the points enclose no volume; scan all sides of the object"
            )
        behind = (_CUP_DOUBT if cup else _DOUBT) * (largest_ball - small_ball) if opening else 0.0
        spread = _doubt(self._volume, ball, found.volume, behind)
        return replace(found, volume_std=spread, between=(small_ball, largest_ball) if larger else None)

    def closed(self) -> Solid:
        """What the largest ball that looks for openings leaves."""
        return self._whole.only(self._peeled(self._tree[0] <= _LEAK_BALLS[-1]))

    def _opens(self, normals: Array | None) -> bool:
        """Whether the ball comes in through an opening, and not through a hole in the sampling."""
        reach = self._tree[0]
        if bare_share(self._whole.only(self._peeled(reach <= _BALL))) >= _SHEETS:
            return False
        behind = (reach > _BALL) & (reach <= _LEAK_BALLS[-1])
        return normals is None or is_cavity(self._whole.only(behind), normals)

    def _has_walls_inside(self) -> bool:
        """Whether many points lie inside of the closed solid, which only the walls of a cup explain."""
        closed = self.closed()
        depths = depths_below(self._points, closed.tetrahedra, closed.surface[0])
        return bool(np.mean(depths > _BEHIND * self.spacing.usual) > _WALLS)

    def _peeled(self, inside: Mask) -> Mask:
        """(T,) what is inside without flat tetrahedra at its surface, which hide points of its plane."""
        kept = np.append(inside, False)
        flat = np.flatnonzero(inside & (self._volumes <= self._flat))
        while len(flat):
            bare = ~kept[self._neighbours[flat]].all(axis=1)
            if not bare.any():
                break
            kept[flat[bare]] = False
            flat = flat[~bare]
        return np.asarray(kept[:-1])

    def _volume(self, ball: float) -> float:
        """m3 that a ball of some radius, in spacings, leaves."""
        return float(self._volumes[self._tree[0] <= ball].sum())


def _delaunay(points: Array) -> tuple[Indices, Indices]:
    """(T, 4) Delaunay tetrahedra of points (N, 3), and (T, 4) those behind the faces; laid out as by `tetrahedra_of`.

    Raises:
        QhullError, numpy.linalg.LinAlgError: the points lie in one plane.
    """
    if COMPILED:
        flatness = np.linalg.eigvalsh(points.T @ points)
        if not flatness[0] > _PLANE_LIKE**2 * flatness[2]:
            raise np.linalg.LinAlgError("the points lie in one plane")
        return tetrahedra_of(points)
    made = Delaunay(points)
    increasing = np.argsort(made.simplices, axis=1)
    tetrahedra = np.take_along_axis(made.simplices, increasing, axis=1).astype(np.int64)
    order = row_order(tetrahedra)
    number = np.full(len(order) + 1, -1)
    number[order] = np.arange(len(order))
    tetrahedra, neighbours = tetrahedra[order], number[np.take_along_axis(made.neighbors, increasing, axis=1)[order]]
    left_handed = tetrahedron_volumes(points[tetrahedra]) < 0
    for rows in (tetrahedra, neighbours):
        rows[left_handed, :2] = rows[left_handed, 1::-1]
    return tetrahedra, neighbours


def _doubt(volume: Callable[[float], float], ball: float, kept: float, behind: float) -> float:
    """m3, one sigma of the carved volume: other balls, an opening that may be a hole after all, pockets.

    Args:
        volume: m3 that a ball of some radius, in spacings, leaves.
        ball: the one that was taken.
        kept: m3 that remain without the pockets.
        behind: m3, one sigma of what is behind an opening.
    """
    low, middle, high = (volume(ball / _BALL * limit) for limit in (_SPREAD[0], _BALL, _SPREAD[1]))
    low = max(low, 2 * middle - high)  # a smaller ball that finds far less has found a hole in the sampling
    pockets = max(volume(ball) - kept, 0.0)
    return float(np.linalg.norm([(high - low) / 2, behind, _POCKET_DOUBT * pockets]))


def _reach(points: Array, coarse: Array, tetrahedra: Indices, neighbours: Indices) -> tuple[Array, Indices, Indices]:
    """(T,) radius of the largest ball, m, that comes into each tetrahedron from outside; over how coarse points are.

    The ball is larger where points are sparse, by `coarse` (N,). The best way in is the path in the widest spanning
    tree, so that one tree answers for balls of every radius; of equal ways it has the first.

    Returns:
        The radii; (T,) the tetrahedra in an order in which each comes after the one that the ball comes from; and
        (T + 1,) that one, T for the outside.
    """
    if COMPILED:
        return ways_in(points, coarse, tetrahedra, neighbours)
    corners, count = points[tetrahedra], len(tetrahedra)
    inner, face = np.nonzero(np.arange(count)[:, None] < np.where(neighbours < 0, count, neighbours))
    outer = neighbours[inner, face]
    own = circumspheres(corners)[1] / coarse[tetrahedra].mean(axis=1)
    facets = tetrahedra[inner[:, None], FACES[face]]
    gates = _circumradius_of_triangles(points[facets]) / coarse[facets].mean(axis=1)
    width = np.minimum(np.minimum(gates, own[inner]), np.where(outer < 0, np.inf, own[outer]))
    out = outer < 0
    widest: Array = np.zeros(count)  # a tetrahedron at a corner of the hull has several ways out
    np.maximum.at(widest, inner[out], width[out])
    ends = np.flatnonzero(widest)
    inner, outer = np.append(inner[~out], ends), np.append(outer[~out], np.full(len(ends), count))
    width = np.maximum(np.append(width[~out], widest[ends]), _TINY)
    rank = np.empty(len(width))
    rank[np.argsort(-width, kind="stable")] = np.arange(1, len(width) + 1)
    tree = minimum_spanning_tree(csr_array((rank, (inner, outer)), shape=(count + 1,) * 2))
    order, parent = breadth_first_order(tree, count, directed=False)
    one, other = tree.nonzero()
    to_parent = np.full(count + 1, np.inf)
    to_parent[np.where(parent[one] == other, one, other)] = np.sort(width)[::-1][tree.data.astype(np.int64) - 1]
    return _least_to_root(to_parent, np.append(parent[:count], count))[:count], order[1:], parent


def _least_to_root(values: Array, parents: Indices) -> Array:
    """(N,) the least of the values (N,) on the way from each node of a tree to its root, which is its own parent.

    In each round a node takes the least of twice as many nodes of its way.
    """
    above = parents
    while np.any(above != above[above]):
        values = np.minimum(values, values[above])
        above = above[above]
    return np.minimum(values, values[above])


def _circumradius_of_triangles(corners: Array) -> Array:
    """(F,) m, of triangles (F, 3, 3)."""
    a, b, c = (lengths(corners[:, i] - corners[:, j]) for i, j in ((1, 2), (0, 2), (0, 1)))
    doubled_area = lengths(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    return np.asarray(a * b * c / np.maximum(2 * doubled_area, _TINY))
