"""Ways of balls into tetrahedra, sides of points on surfaces, and pockets."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.kernels.matching import row_numbers
from poise.types import Array, Indices, Mask

Ways = tuple[Array, Indices, Indices]
_NUMBERS = ("ball", "smallest", "prior", "cost")
_POINTERS = ("points", "facing", "reach", "deep", "inside", "tetrahedra", "order", "parent", "gain", "opened")


def ways_in(points: Array, coarse: Array, tetrahedra: Indices, beside: Indices) -> Ways:
    """How large a ball comes into each tetrahedron; needs `COMPILED`. See `poise.shape.carving`, which does the same.

    Args:
        points: (N, 3) m.
        coarse: (N,) how much coarser than usual they are around each.
        tetrahedra: (T, 4) and beside: (T, 4) the ones behind the faces opposite their corners; -1: outside.

    Returns:
        (T,) radii, m, over how coarse the corners are; the tetrahedra in an order in which each comes after the one
        that the ball comes from; and (T + 1,) that one, T for the outside.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or for numbers of what is not there.
    """
    at = contiguous(points, -1, 3, what="points")
    spaced = contiguous(coarse, len(at), what="coarseness")
    corners = row_numbers(tetrahedra, 4, len(at))
    behind = row_numbers(beside + 1, 4, len(corners) + 1) - 1
    reach, order, parent = (
        np.empty(len(corners)),
        np.empty(len(corners), np.int64),
        np.empty(len(corners) + 1, np.int64),
    )
    found = np.zeros(1, np.int64)
    given = address(at), address(spaced), len(corners), address(corners), address(behind)
    check(library.poise_reach(*given, *map(address, (reach, order, parent, found))))
    return reach, order[: found[0]], parent


def normals_of_planes(points: Array, near: Indices, known: Mask, outward: Array) -> Array:
    """(N, 3) outward unit normals; needs `COMPILED`. See `poise.shape.pockets.oriented_normals`, which does the same.

    Args:
        points: (N, 3) m.
        near: (N, K) nearest points of each, itself first.
        known: (N,) where `outward` (N, 3) shows the side.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or for numbers of points that are not there.
    """
    at = contiguous(points, -1, 3, what="points")
    side = contiguous(outward, len(at), 3, what="outward")
    neighbours = row_numbers(near.reshape(len(at), -1), near.shape[1], len(at))
    shown, normals = np.array(np.broadcast_to(known, len(at)), np.uint8), np.empty_like(at)
    arrays = address(neighbours), address(side), address(shown), address(normals)
    check(library.poise_oriented_normals(len(at), address(at), near.shape[1], *arrays))
    return normals


class _Pockets(ctypes.Structure):
    """Layout of `struct pockets` in kernels/carving.c."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("count", "found")),
        *((name, ctypes.c_double) for name in _NUMBERS),
        *((name, ctypes.c_void_p) for name in _POINTERS),
    ]


def opened_pockets(
    points: Array, tetrahedra: Indices, ways: Ways, inside: Mask, deep: Mask, facing: Array, numbers: dict[str, float]
) -> Mask:
    """(T,) tetrahedra to open; needs `COMPILED`. See `poise.shape.carving`, which does the same.

    Args:
        points: (N, 3) m.
        tetrahedra: (T, 4).
        ways: as of `ways_in`, the first (T,) in spacings.
        inside: (T,) what a larger ball leaves.
        deep: (N,) points inside, and facing: (N, 3) outward normals.
        numbers: what `struct pockets` in kernels/carving.c is given, ball to cost.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or for numbers of what is not there.
    """
    at, (reach, order, parent) = contiguous(points, -1, 3, what="points"), ways
    count = len(tetrahedra)
    given: dict[str, NDArray[Any]] = {
        **{"points": at, "facing": contiguous(facing, len(at), 3, what="normals")},
        "reach": contiguous(reach, count, what="radii"),
        **{"deep": np.array(np.broadcast_to(deep, len(at)), np.uint8), "inside": np.array(inside, np.uint8)},
        "tetrahedra": row_numbers(tetrahedra, 4, len(at)),
        "order": row_numbers(order[:, None], 1, count),
        "parent": row_numbers(parent[:, None], 1, count + 1),
        **{"gain": np.empty(count), "opened": np.empty(count, np.uint8)},
    }
    values = {name: float(numbers[name]) for name in _NUMBERS}
    pockets = _Pockets(count=count, found=len(order), **values, **{name: address(given[name]) for name in _POINTERS})
    library.poise_pockets(ctypes.byref(pockets))
    return np.asarray(given["opened"].astype(bool))
