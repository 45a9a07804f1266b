"""Sums over samples at many lags between two clocks."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.kernels.arrays import address, contiguous
from poise.kernels.library import library
from poise.types import Array, Stamps


def clock_sums(
    when: Stamps, signals: Array, stamps: Stamps, wrenches: Array, lags: Stamps, gap: int
) -> tuple[Array, Array]:
    """Sum s s^T of the motion a lag before each sample, and of its wrench; needs `COMPILED`.

    Args:
        when, signals: (M,) ns, increasing, and (M, 13) of the motion.
        stamps, wrenches: (N,) ns, increasing, and (N, 6) of the samples.
        lags: (L,) ns. gap: ns across which nothing is interpolated.

    Returns:
        (L, 19, 19) sums and (L,) how many samples they are of.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """
    times, own, shifts = (np.ascontiguousarray(each, dtype=np.int64) for each in (when, stamps, lags))
    if not times.ndim == own.ndim == shifts.ndim == 1:
        raise InputError(ErrorCode.TYPE_MISMATCH, "the stamps of two clocks, and lags, are rows of numbers")
    motion = contiguous(signals, len(times), 13, what="signals of the motion")
    measured = contiguous(wrenches, len(own), 6, what="wrenches")
    sums, counts = np.zeros((len(shifts), 19, 19)), np.zeros(len(shifts))
    given = (len(times), address(times), address(motion), len(own), address(own), address(measured))
    library.poise_clock_sums(*given, len(shifts), address(shifts), gap, address(sums), address(counts))
    return sums, counts
