"""Values interpolated at other times."""

import numpy as np
from scipy.interpolate import make_interp_spline

from poise.types import Array


def at_times(seconds: Array, values: Array, wanted: Array) -> Array:
    """(M, ...) values (N, ...) at other times, by a cubic spline; held constant outside."""
    inside = np.clip(wanted, seconds[0], seconds[-1])
    return np.asarray(make_interp_spline(seconds, values, k=3, axis=0)(inside))
