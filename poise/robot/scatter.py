"""The white noise of a stream, estimated from the differences between neighbouring samples."""

import numpy as np

from poise.types import Array

QUIET = 25
"""Percentile over blocks that counts: others may hold shaking, which is no noise."""

BLOCK = 40
"""Samples."""


def scatter(values: Array) -> float:
    """One sigma of the white noise in samples (N, K) in a row; NaN for too few.

    A smooth signal hardly has second differences; white noise of variance s^2 has them with variance 6 s^2.
    """
    bends = np.diff(values, n=2, axis=0)
    count = len(bends) // BLOCK
    if not count:
        return np.nan
    blocks = bends[: count * BLOCK].reshape(count, -1)
    return float(np.sqrt(np.percentile(np.mean(blocks**2, axis=1), QUIET) / 6))
