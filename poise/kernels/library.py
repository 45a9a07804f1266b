"""Finds and loads the compiled library; without numpy, because `poise --version` says whether it is there."""

import ctypes
import importlib.util
import os
from typing import Any

_VERSION = 12
"""Of the interface of the library: POISE_KERNELS_VERSION in kernels/poise_kernels.h."""

_INT, _POINTER = ctypes.c_int64, ctypes.c_void_p
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "poise_chain_motion": (None, [_INT, _INT, *[_POINTER] * 8]),
    "poise_split_records": (_INT, [ctypes.c_char_p, _INT, *[_POINTER] * 4]),
    "poise_smoother_new": (_POINTER, [_INT, _INT, *[_POINTER] * 4, _INT, _INT, _POINTER, _POINTER]),
    "poise_smoother_at": (_INT, [_POINTER, _INT, _INT, _POINTER, _POINTER]),
    "poise_smoother_covariance": (_INT, [_POINTER, *[_INT] * 7, _POINTER, _POINTER]),
    "poise_smoother_free": (None, [_POINTER]),
    "poise_search": (_INT, [_POINTER]),
    "poise_normal_equations": (_INT, [_INT, *[_POINTER] * 3, ctypes.c_double, *[_POINTER] * 3]),
    "poise_clock_sums": (
        None,
        [_INT, _POINTER, _POINTER, _INT, _POINTER, _POINTER, _INT, _POINTER, _INT, _POINTER, _POINTER],
    ),
    "poise_lookup_beyond": (None, [_INT, *[_POINTER] * 3, _INT, *[_POINTER] * 2]),
    "poise_lookup_agreement": (None, [_INT, *[_POINTER] * 3, _INT, _POINTER, ctypes.c_float, *[_POINTER] * 3]),
    "poise_lookup_offsets": (
        None,
        [_INT, *[_POINTER] * 3, _INT, *[_POINTER] * 2, ctypes.c_float, ctypes.c_float, *[_POINTER] * 2],
    ),
    "poise_lookup_pixels": (
        _INT,
        [*[_POINTER] * 2, _INT, _INT, _POINTER, _INT, _POINTER, *[ctypes.c_float] * 4, _POINTER],
    ),
    "poise_robust_fit": (_INT, [_INT, _INT, *[_POINTER] * 4, ctypes.c_double, _INT, *[_POINTER] * 3]),
    "poise_box_minimum": (_INT, [_INT, *[_POINTER] * 6]),
    "poise_pendulum": (None, [_INT, *[_POINTER] * 3, ctypes.c_double, _POINTER]),
    "poise_rope": (
        None,
        [_INT, _INT, *[_POINTER] * 5, ctypes.c_double, _INT, _POINTER],
    ),
    "poise_between_stops": (None, [_INT, *[_POINTER] * 3, *[ctypes.c_double] * 3, _POINTER]),
    "poise_turned_load": (None, [_INT, *[_POINTER] * 4]),
    "poise_turned_in_grip": (
        None,
        [_INT, _INT, *[_POINTER] * 6, *[ctypes.c_double] * 2, _INT, *[ctypes.c_double] * 2, _POINTER],
    ),
    "poise_elastic_new": (_POINTER, [_POINTER]),
    "poise_elastic_free": (None, [_POINTER]),
    "poise_whitened": (
        _INT,
        [_INT, _INT, _POINTER, _POINTER, _INT, _INT, _POINTER, _POINTER, _INT, *[_POINTER] * 3, _INT, *[_POINTER] * 2],
    ),
    "poise_likely_colours": (_INT, [_INT, _INT, *[_POINTER] * 3, _INT, *[_POINTER] * 10]),
    "poise_elastic_descend": (
        None,
        [*[_POINTER] * 3, ctypes.c_double, _INT, ctypes.c_double, _POINTER, _POINTER],
    ),
    "poise_elastic_reach": (
        None,
        [*[_POINTER] * 3, ctypes.c_double, _INT, ctypes.c_double, *[_POINTER] * 3],
    ),
    "poise_elastic_response": (_INT, [_POINTER] * 4),
    "poise_elastic_left": (None, [_POINTER] * 4),
    "poise_elastic_follow": (_INT, [_POINTER] * 2),
    "poise_elastic_factors": (_INT, [_POINTER] * 2),
    "poise_cones_new": (_POINTER, [_POINTER]),
    "poise_cones_solve": (None, [_POINTER, _INT, *[_POINTER] * 8]),
    "poise_cones_renew": (None, [_POINTER]),
    "poise_cones_free": (None, [_POINTER]),
    "poise_delaunay": (_INT, [_INT, _POINTER, _INT, *[_POINTER] * 3]),
    "poise_clusters": (_INT, [_POINTER]),
    "poise_nearest": (_INT, [_INT, _POINTER, ctypes.c_double, _INT, _POINTER, _INT, *[_POINTER] * 2]),
    "poise_side_normals": (_INT, [_INT, _POINTER, ctypes.c_double, _INT, _POINTER]),
    "poise_reach": (_INT, [_POINTER, _POINTER, _INT, *[_POINTER] * 6]),
    "poise_oriented_normals": (_INT, [_INT, _POINTER, _INT, *[_POINTER] * 4]),
    "poise_pockets": (None, [_POINTER]),
    "poise_match": (_INT, [_POINTER]),
    "poise_merge": (_INT, [_POINTER]),
    "poise_first_slips": (None, [_POINTER, _INT, *[_POINTER] * 3]),
}


def _load() -> Any:
    """The library with the types of its functions; None when there is none of this version and platform."""
    found = None if os.environ.get("POISE_KERNELS") == "0" else importlib.util.find_spec("poise_kernels")
    if found is None or not found.has_location or found.origin is None:
        return None
    try:
        library = ctypes.CDLL(found.origin)
        library.poise_kernels_version.restype = _INT
        if library.poise_kernels_version() != _VERSION:
            return None
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError):  # of another platform, not of Poise, or of an earlier one with fewer kernels
        return None
    return library


library = _load()
COMPILED: bool = library is not None
"""Whether the compiled kernels are used."""
