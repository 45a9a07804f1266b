"""Clusters that are merged, the cheapest pair first."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.kernels.matching import row_numbers
from poise.types import Array, Indices

_COUNTS = ("count", "pairs", "borders")
_COSTS = ("constant", "concave", "colour", "spread", "thickness", "smaller", "both", "least", "shading", "one_colour")
_NUMBERS = ("noise", "alike", "haste", "few", "thickest", "smallest", "flattest")
_KNOWN = ("volume", "area", "weight", "shade", "moment")
_POINTERS = ("pair", "border", "border_inwards", "border_edges", *_KNOWN, "merge", "cost")


class _Merging(ctypes.Structure):
    """Layout of `struct merging` in kernels/merging.c."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in _COUNTS),
        *((name, ctypes.c_double) for name in (*_COSTS, *_NUMBERS)),
        *((name, ctypes.c_void_p) for name in _POINTERS),
        ("merges", ctypes.c_int64),
    ]


def merged_clusters(
    pairs: Indices, borders: tuple[Indices, Array, Array], known: dict[str, Array], numbers: dict[str, float]
) -> tuple[Indices, Array]:
    """Merge clusters until nothing touches; needs `COMPILED`. See `poise.shape.hierarchy`, which does the same.

    Args:
        pairs: (K, 2) clusters that touch, the lower first.
        borders: (B, 2) clusters, (B,) numbers of edges along their borders that fold inwards, and (B,) of all edges.
        known: of C clusters, with rows for the C - 1 that they may become: volume, area and weight (2C - 1,), shade
            (2C - 1, 3) and moment (2C - 1, 10); all are filled.
        numbers: what `struct merging` in kernels/merging.c is given, constant to flattest.

    Returns:
        (M, 2) clusters that were merged, into those from C on; and (M,) what that cost.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or for numbers of clusters that are not there.
    """
    most = len(known["volume"])
    count = (most + 1) // 2
    shapes = {"shade": (most, 3), "moment": (most, 10)}
    ends, inwards, edges = borders
    given: dict[str, NDArray[Any]] = {
        **{name: contiguous(known[name], *shapes.get(name, (most,)), what=name) for name in _KNOWN},
        **{"pair": row_numbers(pairs, 2, count), "border": row_numbers(ends, 2, count)},
        "border_inwards": contiguous(inwards, len(ends), what="edges that fold inwards"),
        "border_edges": contiguous(edges, len(ends), what="numbers of edges"),
        **{"merge": np.empty((count, 2), np.int64), "cost": np.empty(count)},
    }
    sizes = dict(zip(_COUNTS, (count, len(pairs), len(ends)), strict=True))
    values = {name: float(numbers[name]) for name in (*_COSTS, *_NUMBERS)}
    merging = _Merging(**sizes, **values, **{name: address(given[name]) for name in _POINTERS})
    check(library.poise_merge(ctypes.byref(merging)))
    return given["merge"][: merging.merges], given["cost"][: merging.merges]
