"""Passes arrays to the compiled library, and raises what its status says."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.types import Array

_NO_MEMORY, _NOT_POSITIVE, _SINGULAR = 1, 2, 3


def contiguous(values: ArrayLike, *shape: int, what: str) -> Array:
    """The values as doubles in C order.

    Args:
        values: of the given shape; -1 stands for any length. what: name for a message.

    Raises:
        InputError: TYPE_MISMATCH for another shape.
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    found = array.shape
    if found != shape and (
        len(found) != len(shape)
        or found != tuple([got if want < 0 else want for want, got in zip(shape, found, strict=False)])
    ):
        raise InputError(ErrorCode.TYPE_MISMATCH, f"{what} has shape {array.shape}, expected {shape}")
    return array


def address(array: NDArray[Any] | None) -> int | None:
    """Of the first element, for the library; None stays."""
    if array is None:
        return None
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))  # five times faster than array.ctypes
    except (TypeError, ValueError):  # it is read-only, or empty
        return int(array.ctypes.data)


def check(status: int) -> None:
    """Raise what a status of the library stands for.

    Raises:
        MemoryError, numpy.linalg.LinAlgError: as the forms in Python do.
    """
    if status == _NO_MEMORY:
        raise MemoryError("no memory for a compiled kernel")
    if status == _NOT_POSITIVE:
        raise np.linalg.LinAlgError("a normal matrix is not positive definite")
    if status == _SINGULAR:
        raise np.linalg.LinAlgError("a system of equations is singular")
