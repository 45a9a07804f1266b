"""The rounds in which a surface moves until points drawn from it lie as the observed ones do."""

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.kernels.neighbours import finite
from poise.types import Array, Indices

_COUNTS = ("vertices", "triangles", "used", "edges", "drawn", "observed")
_STEPS = ("rounds", "noise_rounds", "second_look", "neighbours", "together")
_NUMBERS = ("noise", "spacing", "smooth", "band_sigmas", "band_spacings", "least_step", "most_step")
_SHARES = ("good", "thick_good", "haste", "cube")
_POINTERS = ("triangle", "use", "edge", "which", "within", "errors", "points", "places", "seen", "made")
_CUBE = 1.5
"""Spacings of the grid that nearest places are looked for in."""


class _Match(ctypes.Structure):
    """Layout of `struct match` in kernels/matching.c."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in (*_COUNTS, *_STEPS)),
        *((name, ctypes.c_double) for name in (*_NUMBERS, *_SHARES)),
        *((name, ctypes.c_void_p) for name in _POINTERS),
        *((name, ctypes.c_int64) for name in ("n_seen", "n_made")),
    ]


@dataclass(frozen=True, eq=False)
class Drawn:
    """Where points are drawn from a surface.

    Args:
        which: (M,) triangles.
        within: (M, 3) weights of their corners.
        errors: (M, 3) in units of the noise.
    """

    which: Indices
    within: Array
    errors: Array


def matched_places(
    places: Array, triangles: Indices, edges: Indices, drawn: Drawn, observed: Array, numbers: dict[str, float]
) -> tuple[Array, float, Array, Array]:
    """Move the vertices of a surface; needs `COMPILED`. See `poise.shape.matching`, which does the same.

    Args:
        places: (V, 3) m, of the vertices.
        triangles: (F, 3) and edges: (E, 2) numbers of the vertices; edges in both directions.
        drawn: M points. observed: (N, 3) m.
        numbers: what `struct match` in kernels/matching.c is given, rounds to haste.

    Returns:
        (V, 3) m places, the noise, m, and the distances of observed and of drawn points that are near, m outwards.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes or not finite, or for numbers of what is not there.
    """
    found = np.array(finite(places, "places"))
    given: dict[str, NDArray[Any]] = {
        **{"triangle": row_numbers(triangles, 3, len(found)), "edge": row_numbers(edges, 2, len(found))},
        **{"which": row_numbers(drawn.which[:, None], 1, len(triangles)), "use": np.unique(triangles)},
        "within": contiguous(drawn.within, len(drawn.which), 3, what="weights of corners"),
        "errors": contiguous(drawn.errors, len(drawn.which), 3, what="errors"),
        "points": finite(observed, "observed points"),
        **{"places": found, "seen": np.empty(len(observed)), "made": np.empty(len(drawn.which))},
    }
    counts = (len(found), len(triangles), len(given["use"]), len(edges), len(drawn.which), len(observed))
    steps = {name: int(numbers[name]) for name in _STEPS}
    steps["neighbours"] = min(steps["neighbours"], len(given["use"]))
    values = {name: float(numbers[name]) for name in (*_NUMBERS, *_SHARES[:-1])}
    pointers = {name: address(given[name]) for name in _POINTERS}
    sizes = dict(zip(_COUNTS, counts, strict=True))
    match = _Match(**sizes, **steps, **values, cube=_CUBE * numbers["spacing"], **pointers)
    check(library.poise_match(ctypes.byref(match)))
    return found, float(match.noise), given["seen"][: match.n_seen], given["made"][: match.n_made]


def row_numbers(rows: Indices, columns: int, most: int) -> Indices:
    """Rows of numbers (K, columns) below a limit, in C order.

    Raises:
        InputError: TYPE_MISMATCH for others.
    """
    numbers = np.ascontiguousarray(rows, dtype=np.int64)
    if (
        numbers.ndim != 2
        or numbers.shape[1] != columns
        or (len(numbers) and not 0 <= numbers.min() <= numbers.max() < most)
    ):
        raise InputError(
            ErrorCode.TYPE_MISMATCH, f"numbers of shape {numbers.shape} for {columns} columns below {most}"
        )
    return numbers
