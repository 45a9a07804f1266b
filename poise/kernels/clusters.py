"""Points of a surface that become clusters."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.kernels.matching import row_numbers
from poise.types import Array, Indices

_NUMBERS = ("position", "colour", "inward", "outward", "shading", "equal")
_POINTERS = ("at", "shade", "normal", "edge", "label")


class _Clusters(ctypes.Structure):
    """Layout of `struct clusters` in kernels/clusters.c."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("points", "edges", "wanted", "rounds")),
        *((name, ctypes.c_double) for name in _NUMBERS),
        *((name, ctypes.c_void_p) for name in _POINTERS),
    ]


def clustered_points(
    features: tuple[Array, Array, Array], edges: Indices, wanted: int, rounds: int, numbers: dict[str, float]
) -> Indices:
    """(N,) cluster of each point, numbered from 0; needs `COMPILED`. See `poise.shape.clustering`, which does the same.

    Args:
        features: (N, 3) positions, colours and normals.
        edges: (E, 2) neighbours.
        wanted: clusters at which merging stops. rounds: the most.
        numbers: what `struct clusters` in kernels/clusters.c is given, position to equal.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, or for numbers of points that are not there.
    """
    count = len(features[0])
    given: dict[str, NDArray[Any]] = {
        name: contiguous(each, count, 3, what=name) for name, each in zip(_POINTERS, features, strict=False)
    }
    given |= {"edge": row_numbers(edges, 2, count), "label": np.empty(count, np.int64)}
    sizes = {"points": count, "edges": len(edges), "wanted": wanted, "rounds": rounds}
    values = {name: float(numbers[name]) for name in _NUMBERS}
    clusters = _Clusters(**sizes, **values, **{name: address(given[name]) for name in _POINTERS})
    check(library.poise_clusters(ctypes.byref(clusters)))
    return np.asarray(given["label"])
