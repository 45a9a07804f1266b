"""Gaps between surfaces that face each other, and that the ball which carves a solid did not enter.

A gap between two handles that is narrower than the ball leaves their facing sides inside of the solid. Which way those
face is found by following the surface from where the solid shows it, and where walls are sheets, by what lies above.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree

from poise.geometry import cross, distinct_numbers, lengths
from poise.kernels import COMPILED, normals_of_planes, opened_pockets
from poise.shape.nearest import nearest
from poise.shape.solid import FACES
from poise.types import Array, Indices, Mask

DEEP, _COVERED, BURIED = 1.0, 0.15, 2.5
"""Spacings under the surface from which on a point is of the wall of a pocket, and under a sheet; and sigmas from which
on it is no noise."""
_COST = 0.1
"""What the normals have to say for a gap in each tetrahedron of a pocket, at the least, as a cosine."""
_POCKET = 1.2
"""Radius, in spacings, of the smallest ball that may enter a pocket."""
_PRIOR = 0.45
"""What speaks for each tetrahedron that the ball reaches."""
_FEWEST_DEEP = 4
_SHEET_POINTS, _SHEET_REACH, _SAME_WAY, _OVER = 3, 1.6, 0.5, 0.7
"""Points of the outer face within so many spacings above a point of the inner face of a sheet; the cosine between the
normals of both from which on they face the same way; and height of the outer face over the depth of the point."""
_FACETS = 8
"""Nearest triangles, by their middles, that the distance to a surface is taken from."""
_PLANE = 12
"""Points that a normal is found from."""
_TINY = 1e-30


@dataclass(frozen=True, eq=False)
class Entrances:
    """Delaunay tetrahedra of points, and how a ball comes into each.

    Args:
        points: (N, 3) m.
        spacing: m between neighbours.
        tetrahedra, neighbours: (T, 4) point numbers, and the tetrahedron behind the face opposite each; -1: outside.
        tree: (T,) radius in spacings of the largest ball that comes in; (T,) the tetrahedra in an order in which each
            comes after the one that the ball comes from; and (T + 1,) that one, T for the outside.
    """

    points: Array
    spacing: float
    tetrahedra: Indices
    neighbours: Indices
    tree: tuple[Array, Indices, Indices]


def pockets(ways: Entrances, inside: Mask, ball: float, noise: float, normals: Array | None) -> Mask:
    """(T,) what a smaller ball would carve away, too, and rightly so: surfaces that face each other have a gap between.

    What to open is the cut of the tree of
    ways in that gains most: what the normals of deep points say, for a gap or against it, less `_COST` for each
    tetrahedron. A hole in the sampling, through which a small ball leaks into the object, gains nothing.

    Args:
        ways: how balls come in.
        inside: (T,) the solid without pockets.
        ball: spacings, radius of the ball that carved it.
        noise: m, one sigma of the points.
        normals: (N, 3) outward unit normals, where they were measured.
    """
    points, tetrahedra = ways.points, ways.tetrahedra
    reach = ways.tree[0]
    outside = ~np.append(inside, False)
    owner, corner = np.nonzero(inside[:, None] & outside[ways.neighbours])
    facets = np.take_along_axis(tetrahedra[owner], FACES[corner], axis=1)
    nothing = np.zeros(len(inside), bool)
    deep = depths_inside(points, tetrahedra[inside], facets) > DEEP * ways.spacing + BURIED * noise
    depths = depths_below(points, tetrahedra[inside], facets)
    covered = depths > _COVERED * ways.spacing + BURIED * noise
    fits = reach > ball
    if covered.sum() < _FEWEST_DEEP and not np.any(fits & inside):
        return nothing
    facing = normals
    if facing is None:
        facing = oriented_normals(points, facets)
        inner = _under_sheets(points, facets, np.where(covered, depths, 0.0), facing, ways.spacing)
        facing[inner] *= -1
        deep[inner] = True
    if COMPILED:
        numbers = {"ball": ball, "smallest": _POCKET, "prior": _PRIOR, "cost": _COST}
        return opened_pockets(points, tetrahedra, ways.tree, inside, deep, facing, numbers)
    return _opened(ways, inside, deep, facing, ball)


def _opened(ways: Entrances, inside: Mask, deep: Mask, facing: Array, ball: float) -> Mask:
    """The cut of `pockets`, as `opened_pockets` makes it."""
    points, tetrahedra = ways.points, ways.tetrahedra
    reach, order, parents = ways.tree
    fits = reach > ball
    corners = points[tetrahedra]
    toward = corners.mean(axis=1)[:, None] - corners
    toward /= np.maximum(lengths(toward), 1e-30)[..., None]
    says = np.einsum("tki,tki->tk", toward, facing[tetrahedra])
    shallow = ~deep[tetrahedra] & ~fits[:, None]
    says[shallow] = np.minimum(says[shallow], 0)
    worth = says.mean(axis=1) + np.where(fits, _PRIOR, -_COST)
    worth[inside & (reach < _POCKET)] = -np.inf
    gains, above = worth.tolist(), parents.tolist()
    walk = [tetrahedron for tetrahedron in order.tolist() if tetrahedron < len(inside) and inside[tetrahedron]]
    for tetrahedron in reversed(walk):
        parent = above[tetrahedron]
        if gains[tetrahedron] > 0 and parent < len(inside) and inside[parent]:
            gains[parent] += gains[tetrahedron]
    opened = np.append(~inside, True)
    for tetrahedron in walk:
        opened[tetrahedron] = gains[tetrahedron] > 0 and opened[above[tetrahedron]]
    return np.asarray(opened[:-1] & inside)


def _under_sheets(points: Array, facets: Indices, depths: Array, facing: Array, spacing: float) -> Indices:
    """Rows of points on the inner face of a sheet whose normals are those of its outer face.

    Where a wall is thinner than the spacing, most neighbours of a point on its inner face are on the outer one, and the
    normal that follows from them faces the same way. But what lies inside of the solid, close below points of its
    surface, is no part of that surface. Below a gap that the ball did not enter there are no points close above, and
    points of a wall that goes on inside of the solid are beside its surface, not below it.

    Args:
        points: (N, 3) m.
        facets: (F, 3) triangles around the solid, counter-clockwise from outside.
        depths: (N,) m that points are below the triangles; 0: on the surface.
        facing: (N, 3) outward unit normals as neighbours show them.
        spacing: m between points.
    """
    inner, shell = np.flatnonzero(depths), distinct_numbers(facets)
    if not len(inner) or len(shell) < _SHEET_POINTS:
        return inner[:0]
    close = nearest(points[shell], points[inner], _SHEET_POINTS)[0][:, -1]
    corners = points[facets]
    outward = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward /= np.maximum(lengths(outward), _TINY)[:, None]
    middles = corners.mean(axis=1)
    facet = nearest(middles, points[inner], 1)[1][:, 0]
    alike = np.einsum("ni,ni->n", outward[facet], facing[inner]) > _SAME_WAY
    over = np.einsum("ni,ni->n", outward[facet], middles[facet] - points[inner]) > _OVER * depths[inner]
    return np.asarray(inner[alike & over & (close < _SHEET_REACH * spacing)])


def depths_inside(points: Array, tetrahedra: Indices, facets: Indices) -> Array:
    """(N,) m from points inside of a solid to the nearest that is not; 0 for those.

    Args:
        points: (N, 3) m.
        tetrahedra, facets: (T, 4) and (F, 3) numbers of the points that it is made of, and around it.
    """
    buried = _buried(points, tetrahedra, facets)
    depths = np.zeros(len(points))
    if buried.any():
        depths[buried] = cKDTree(points[~buried]).query(points[buried])[0]
    return depths


def depths_below(points: Array, tetrahedra: Indices, facets: Indices) -> Array:
    """(N,) m from points inside of a solid to the triangles around it; 0 for those that are not inside.

    Unlike `depths_inside` it does not count a point that a flat tetrahedron just covers, which is a whole spacing away
    from the nearest one that is not.

    Args:
        points, tetrahedra, facets: as of `depths_inside`.
    """
    buried = _buried(points, tetrahedra, facets)
    depths = np.zeros(len(points))
    if buried.any():
        corners = points[facets]
        near = cKDTree(corners.mean(axis=1)).query(points[buried], k=min(_FACETS, len(facets)))[1]
        near = near.reshape(int(buried.sum()), -1)
        depths[buried] = _to_triangles(points[buried], corners[near]).min(axis=1)
    return depths


def _buried(points: Array, tetrahedra: Indices, facets: Indices) -> Mask:
    buried = np.zeros(len(points), bool)
    buried[tetrahedra] = True
    buried[facets] = False
    return buried


def _to_triangles(points: Array, corners: Array) -> Array:
    """(N, K) m from points (N, 3) to triangles (N, K, 3, 3)."""
    offset = corners - points[:, None, None]
    following = np.roll(offset, -1, axis=2)
    edge = following - offset
    length = np.maximum(np.einsum("nkei,nkei->nke", edge, edge), _TINY)
    along = np.clip(-np.einsum("nkei,nkei->nke", offset, edge) / length, 0, 1)
    beside = np.linalg.norm(offset + along[..., None] * edge, axis=3).min(axis=2)
    normal = np.cross(edge[:, :, 0], edge[:, :, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=2), _TINY)[..., None]
    sides = np.einsum("nkei,nki->nke", np.cross(offset, following), normal)
    over = np.abs(np.einsum("nki,nki->nk", offset[:, :, 0], normal))
    return np.asarray(np.where((sides > 0).all(axis=2), over, beside))


def oriented_normals(points: Array, facets: Indices) -> Array:
    """(N, 3) outward unit normals of points, from their neighbours, with the side that some of them have on facets.

    The side is handed on from neighbour to neighbour where the surface bends least (Hoppe et al. 1992).

    Args:
        points: (N, 3) m.
        facets: (F, 3) triangles around the solid, counter-clockwise from outside; they show the side of their corners.
    """
    count = len(points)
    near = nearest(points, points, min(_PLANE, count))[1]
    a, b, c = (points[facets[:, k]] for k in range(3))
    across = cross(b - a, c - a)
    sums: Array = np.stack(
        [np.bincount(facets.ravel(), np.repeat(column, 3), count) for column in across.T], axis=1
    ).astype(np.float64)
    known = np.bincount(facets.ravel(), minlength=count) > 0
    if COMPILED:
        return normals_of_planes(points, near, known, sums)
    offsets = points[near] - points[near].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))[1][:, :, 0]
    shown = np.flatnonzero(known)
    normals[shown] *= np.where(np.einsum("ij,ij->i", normals[shown], sums[shown]) < 0, -1.0, 1.0)[:, None]
    i, j = np.repeat(np.arange(count), near.shape[1] - 1), near[:, 1:].ravel()
    bend = 1.01 - np.abs(np.einsum("ij,ij->i", normals[i], normals[j]))
    root = np.full(len(shown), count)
    graph = coo_array(
        (np.concatenate([bend, np.full(len(shown), 1e-3)]), (np.concatenate([i, root]), np.concatenate([j, shown]))),
        shape=(count + 1, count + 1),
    ).tocsr()
    order, parents = breadth_first_order(minimum_spanning_tree(graph), count, directed=False)
    below = order[1:][~known[order[1:]]]
    turned = np.einsum("ij,ij->i", normals[below], normals[parents[below]]) < 0
    inwards = np.zeros(count, bool).tolist()
    for point, parent, turn in zip(below.tolist(), parents[below].tolist(), turned.tolist(), strict=True):
        inwards[point] = inwards[parent] != turn
    normals[inwards] *= -1
    return np.asarray(normals)
