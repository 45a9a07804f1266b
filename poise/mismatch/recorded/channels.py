"""Names of the wrench channels, and vectors in words."""

from collections.abc import Sequence

import numpy as np

WRENCH_CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Of a wrench, in the order of its columns."""


def directed(vector: Sequence[float], unit: str) -> str:
    """A vector's size and main direction: '9.1 N, mostly along +x'."""
    values = np.asarray(vector, dtype=np.float64)
    size = float(np.linalg.norm(values))
    if size == 0.0:
        return f"0 {unit}"
    axis = int(np.argmax(np.abs(values)))
    mostly = "along" if abs(values[axis]) > 0.95 * size else "mostly along"
    return f"{size:.3g} {unit}, {mostly} {'+' if values[axis] > 0 else '-'}{'xyz'[axis]}"
