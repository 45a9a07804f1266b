"""Finds and loads the compiled library, and passes arrays to it."""

import ctypes
import importlib.util
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.types import Array

_VERSION = 1
"""Of the interface of the library: POISE_KERNELS_VERSION in kernels/poise_kernels.h."""

_INT, _POINTER = ctypes.c_int64, ctypes.c_void_p
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "poise_chain_motion": (None, [_INT, _INT, *[_POINTER] * 8]),
    "poise_split_records": (_INT, [ctypes.c_char_p, _INT, *[_POINTER] * 4]),
    "poise_smoother_new": (_POINTER, [_INT, _INT, *[_POINTER] * 4, _INT, _INT, _POINTER, _POINTER]),
    "poise_smoother_at": (_INT, [_POINTER, _INT, _INT, _POINTER, _POINTER]),
    "poise_smoother_covariance": (_INT, [_POINTER, *[_INT] * 7, _POINTER, _POINTER]),
    "poise_smoother_free": (None, [_POINTER]),
}
_NO_MEMORY, _NOT_POSITIVE = 1, 2


def _load() -> Any:
    """The library with the types of its functions; None when there is none of this version."""
    found = None if os.environ.get("POISE_KERNELS") == "0" else importlib.util.find_spec("poise_kernels")
    if found is None or not found.has_location or found.origin is None:
        return None
    library = ctypes.CDLL(found.origin)
    library.poise_kernels_version.restype = _INT
    if library.poise_kernels_version() != _VERSION:
        return None
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


library = _load()
COMPILED: bool = library is not None
"""Whether the compiled kernels are used."""


def contiguous(values: ArrayLike, *shape: int, what: str) -> Array:
    """The values as doubles in C order.

    Args:
        values: of the given shape; -1 stands for any length. what: name for a message.

    Raises:
        InputError: TYPE_MISMATCH for another shape.
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != len(shape) or any(want not in (-1, got) for want, got in zip(shape, array.shape, strict=True)):
        raise InputError(ErrorCode.TYPE_MISMATCH, f"{what} has shape {array.shape}, expected {shape}")
    return array


def address(array: NDArray[Any] | None) -> int | None:
    """Of the first element, for the library; None stays."""
    return None if array is None else int(array.ctypes.data)


def check(status: int) -> None:
    """Raise what a status of the library stands for.

    Raises:
        MemoryError, numpy.linalg.LinAlgError: as the forms in Python do.
    """
    if status == _NO_MEMORY:
        raise MemoryError("no memory for the splines of a stretch of samples")
    if status == _NOT_POSITIVE:
        raise np.linalg.LinAlgError("the normal matrix of a spline is not positive definite")
