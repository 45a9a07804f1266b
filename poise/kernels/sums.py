"""Normal equations of sums over samples."""

import numpy as np

from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.types import Array

_UNKNOWNS = 16


def weighed_sums(
    moments: Array, counts: Array, covariance: Array, variance: float, entries: Array
) -> tuple[Array, Array]:
    """Normal equations (L, 16, 16) and (L, 16) of sums over samples; see `poise.inertia.model.normal_equations`.

    Args:
        moments, counts: (L, 19, 19) and (L,).
        covariance: (6, 6) of a residual.
        variance: (rad/s2)^2, noise of the angular accelerations.
        entries: (6, 16, 13) the design by signals.

    Raises:
        numpy.linalg.LinAlgError: the covariance is not positive definite.
    """
    sums = contiguous(moments, -1, 19, 19, what="sums over samples")
    numbers = contiguous(counts, len(sums), what="counts of samples")
    spread = contiguous(covariance, 6, 6, what="covariance of a residual")
    design = contiguous(entries, 6, _UNKNOWNS, 13, what="the design by signals")
    information, vector = np.empty((len(sums), _UNKNOWNS, _UNKNOWNS)), np.empty((len(sums), _UNKNOWNS))
    given = map(address, (sums, numbers, spread))
    found = map(address, (design, information, vector))
    check(library.poise_normal_equations(len(sums), *given, variance, *found))
    return information, vector
