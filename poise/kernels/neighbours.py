"""Points in space: the nearest of them, and the Delaunay tetrahedra between them."""

import numpy as np

from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.types import Array, Indices

_ROOM = 12
"""Tetrahedra for each point that there is room for at first: on surfaces there are about 6."""


def tetrahedra_of(points: Array) -> tuple[Indices, Indices]:
    """Delaunay tetrahedra of points (N, 3); needs `COMPILED`. See `poise.shape.carving`, which does the same.

    Coordinates count to 2^-24 of the largest extent; of points that are the same to that, one is used.

    Returns:
        (T, 4) points of each tetrahedron, increasing, in lexicographic order; and (T, 4) the tetrahedron behind the face
        opposite each, -1 for none.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
        numpy.linalg.LinAlgError: the points lie in one plane.
    """
    at = contiguous(points, -1, 3, what="points")
    room, found = _ROOM * len(at), np.zeros(1, np.int64)
    while True:
        tetrahedra, beside = np.empty((room, 4), np.int64), np.empty((room, 4), np.int64)
        arrays = map(address, (tetrahedra, beside, found))
        check(library.poise_delaunay(len(at), address(at), room, *arrays))
        if found[0] <= room:
            return tetrahedra[: found[0]], beside[: found[0]]
        room = int(found[0])
