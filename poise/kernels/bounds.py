"""Least squares with bounds."""

import numpy as np

from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.types import Array


def bounded_minimum(normal: Array, right: Array, lower: Array, upper: Array, near: Array | None) -> Array:
    """(k,) the least of x' normal x / 2 - right' x with lower <= x <= upper; needs `COMPILED`.

    Args:
        normal: (k, k) positive definite.
        right, lower, upper: (k,); every coefficient has one finite bound at least.
        near: (k,) the least of a similar problem; None: none is known.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
        numpy.linalg.LinAlgError: `normal` is not positive definite.
    """
    count = len(right)
    matrix = contiguous(normal, count, count, what="the normal matrix")
    sides = [contiguous(each, count, what="right side and bounds") for each in (right, lower, upper)]
    begin = None if near is None else contiguous(near, count, what="the start")
    found = np.empty(count)
    check(library.poise_box_minimum(count, address(matrix), *map(address, sides), address(begin), address(found)))
    return found
