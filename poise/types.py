"""The array types that every room uses."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers; the docstring of each function gives the shape and the unit."""

Single = NDArray[np.float32]
"""Numbers in single precision: images and their clouds."""

Indices = NDArray[np.int64]
"""Whole numbers: indices, labels and counts."""

Stamps = NDArray[np.int64]
"""(N,) nanoseconds since the epoch, as in message headers."""

Mask = NDArray[np.bool_]
"""One truth value for each row."""

Progress = Callable[[float], None]
"""Called with the share of a job that is done, 0 to 1."""

Cancelled = Callable[[], bool]
"""Asked now and then by a long job: whether to give up."""
