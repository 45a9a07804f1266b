"""Iteratively reweighted least squares of wrenches."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.types import Array


def robust_fit(
    matrix: Array, wrench: Array, used: Array | None, *, least: Array, huber: float, rounds: int
) -> tuple[Array, Array, Array]:
    """Fit unknowns; needs `COMPILED`. See `poise.weighing.fitting`, which does the same.

    Args:
        matrix: (N, 6, P) design. wrench: (N, 6) N and N m, finite.
        used: (N, 6) 0 for readings that do not count, else 1; None: all count.
        least: (2,) noise of force and torque, N and N m. huber: in units of the noise. rounds: 1 or more.

    Returns:
        Unknowns (P,), roots of the weights (N, 6), residual (N, 6).

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes, TOO_FEW_SAMPLES for none.
        numpy.linalg.LinAlgError: the normal matrix is singular.
    """
    given = contiguous(wrench, -1, 6, what="wrenches")
    count = len(given)
    if not count or rounds < 1:
        raise InputError(ErrorCode.TOO_FEW_SAMPLES, f"a fit of {count} wrenches in {rounds} rounds")
    design = contiguous(matrix, count, 6, -1, what="the design")
    counts = None if used is None else contiguous(used, count, 6, what="what is used")
    noise = contiguous(least, 2, what="the least noise")
    columns = design.shape[2]
    unknowns, root, residual = np.empty(columns), np.empty((count, 6)), np.empty((count, 6))
    arrays = map(address, (design, given, counts, noise))
    found = map(address, (unknowns, root, residual))
    check(library.poise_robust_fit(count, columns, *arrays, huber, rounds, *found))
    return unknowns, root, residual
