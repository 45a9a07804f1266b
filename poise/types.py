"""The array types that every room uses."""

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
