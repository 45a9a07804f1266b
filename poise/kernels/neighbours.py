"""Points in space: the nearest of them, and the Delaunay tetrahedra between them."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.types import Array, Indices

_MOST = 64
_ROOM = 12
"""Tetrahedra for each point that there is room for at first: on surfaces there are about 6."""


def finite(points: Array, what: str) -> Array:
    """Points (N, 3) in C order.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or not finite.
    """
    at = contiguous(points, -1, 3, what=what)
    if not np.isfinite(at).all():
        raise InputError(ErrorCode.TYPE_MISMATCH, f"{what} that are not finite")
    return at


def tetrahedra_of(points: Array) -> tuple[Indices, Indices]:
    """Delaunay tetrahedra of points (N, 3); needs `COMPILED`. See `poise.shape.carving`, which does the same.

    Coordinates count to 2^-24 of the largest extent; of points that are the same to that, one is used.

    Returns:
        (T, 4) points of each tetrahedron, and (T, 4) the one behind the face opposite each, -1 for none. The tetrahedra
        are right-handed, where they are flat as their neighbours say. The points of each are in increasing order,
        but for the first two; and the tetrahedra in that of their increasing points.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or not finite.
        numpy.linalg.LinAlgError: the points lie in one plane.
    """
    at = finite(points, "points")
    room, found = _ROOM * len(at), np.zeros(1, np.int64)
    while True:
        tetrahedra, beside = np.empty((room, 4), np.int64), np.empty((room, 4), np.int64)
        arrays = map(address, (tetrahedra, beside, found))
        check(library.poise_delaunay(len(at), address(at), room, *arrays))
        if found[0] <= room:
            return tetrahedra[: found[0]], beside[: found[0]]
        room = int(found[0])


def nearest_of(points: Array, places: Array, count: int, cube: float) -> tuple[Array, Indices]:
    """The nearest of points (N, 3) to places (M, 3), that are not far from them; needs `COMPILED`.

    As `scipy.spatial.cKDTree.query`, which is faster where places are far away.

    Args:
        count: K of them, 64 at the most.
        cube: m, about twice the spacing of the points.

    Returns:
        (M, K) m, and (M, K) points, nearest first.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or not finite, or more neighbours than there are.
    """
    at, asked = finite(points, "points"), finite(places, "places")
    if not 0 < count <= min(len(at), _MOST):
        raise InputError(ErrorCode.TYPE_MISMATCH, f"{count} of {len(at)} points")
    numbers, distances = np.empty((len(asked), count), np.int64), np.empty((len(asked), count))
    arrays = map(address, (numbers, distances))
    check(library.poise_nearest(len(at), address(at), cube, len(asked), address(asked), count, *arrays))
    return distances, numbers


def side_averages(points: Array, normals: Array, radius: float, rounds: int) -> Array:
    """(N, 3) normals averaged over those of the same side; needs `COMPILED`. See `poise.shape.surface_fit`.

    Args:
        points: (N, 3) m.
        normals: (N, 3) unit vectors.
        radius: m, within which points count.
        rounds: of averaging.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or not finite.
    """
    at = finite(points, "points")
    found = np.array(contiguous(normals, len(at), 3, what="normals"))
    check(library.poise_side_normals(len(at), address(at), radius, rounds, address(found)))
    return found
