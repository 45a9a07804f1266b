"""Clusters that are merged, the cheapest pair first."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.kernels.matching import row_numbers
from poise.types import Array, Indices

_COUNTS = ("count", "directions", "corners", "pairs", "borders")
_COSTS = ("colour", "fold", "hollow", "size", "least", "shading", "one_colour", "smooth")
_NUMBERS = ("noise", "total", "folded", "alike", "haste", "few")
_KNOWN = ("reach", "points", "volume", "hull", "shade", "weight")
_POINTERS = ("pair", "border", "border_fold", "border_edges", "corner", *_KNOWN, "merge", "cost")


class _Merging(ctypes.Structure):
    """Layout of `struct merging` in kernels/merging.c."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in _COUNTS),
        *((name, ctypes.c_double) for name in (*_COSTS, *_NUMBERS)),
        *((name, ctypes.c_void_p) for name in _POINTERS),
        ("merges", ctypes.c_int64),
    ]


def merged_clusters(
    pairs: Indices,
    borders: tuple[Indices, Array, Array],
    corners: Indices,
    known: dict[str, Array],
    numbers: dict[str, float],
) -> tuple[Indices, Array]:
    """Merge clusters until nothing touches; needs `COMPILED`. See `poise.shape.hierarchy`, which does the same.

    Args:
        pairs: (K, 2) clusters that touch, the lower first.
        borders: (B, 2) clusters, (B,) sums of folds along their borders, and (B,) numbers of edges.
        corners: (T, 3) directions whose outermost points are the corners of the triangles of a hull.
        known: of C clusters, with rows for the C - 1 that they may become: reach (2C - 1, D) and points (2C - 1, 3, D)
            in D directions, volume, hull and weight (2C - 1,), shade (2C - 1, 3); all are filled.
        numbers: what `struct merging` in kernels/merging.c is given, colour to few.

    Returns:
        (M, 2) clusters that were merged, into those from C on; and (M,) what that cost.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or for numbers of clusters that are not there.
    """
    most, directions = known["reach"].shape
    count = (most + 1) // 2
    shapes = {"reach": (most, directions), "points": (most, 3, directions), "shade": (most, 3)}
    ends, folds, edges = borders
    given: dict[str, NDArray[Any]] = {
        **{name: contiguous(known[name], *shapes.get(name, (most,)), what=name) for name in _KNOWN},
        **{"pair": row_numbers(pairs, 2, count), "border": row_numbers(ends, 2, count)},
        "border_fold": contiguous(folds, len(ends), what="folds"),
        "border_edges": contiguous(edges, len(ends), what="numbers of edges"),
        "corner": np.ascontiguousarray(row_numbers(corners, 3, directions).T, dtype=np.int32),
        **{"merge": np.empty((count, 2), np.int64), "cost": np.empty(count)},
    }
    sizes = dict(zip(_COUNTS, (count, directions, len(corners), len(pairs), len(ends)), strict=True))
    values = {name: float(numbers[name]) for name in (*_COSTS, *_NUMBERS)}
    merging = _Merging(**sizes, **values, **{name: address(given[name]) for name in _POINTERS})
    check(library.poise_merge(ctypes.byref(merging)))
    return given["merge"][: merging.merges], given["cost"][: merging.merges]


def hulls_of_clusters(
    points: Array, tetrahedra: Indices, clusters: Indices, count: int, directions: Array
) -> tuple[Array, Array]:
    """Hulls of clusters of tetrahedra; needs `COMPILED`. See `poise.shape.hulls`, which does the same.

    Args:
        points: (N, 3) m.
        tetrahedra: (T, 4), and clusters: (T,) of them, 0..count-1, none empty.
        directions: (D, 3) unit vectors.

    Returns:
        (count, D) m along the directions, and (count, 3, D) m, the outermost points.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or for numbers of what is not there.
    """
    at, along = contiguous(points, -1, 3, what="points"), contiguous(directions.T, 3, -1, what="directions")
    corners, own = row_numbers(tetrahedra, 4, len(at)), row_numbers(clusters[:, None], 1, count)
    reach, outermost = np.empty((count, along.shape[1])), np.empty((count, *along.shape))
    given = len(at), address(at), len(corners), address(corners), address(own), count, along.shape[1], address(along)
    check(library.poise_hulls(*given, address(reach), address(outermost)))
    return reach, outermost
