"""A way in which a driver may be wrong, and what may be said of it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.foreign.bag import Streams
from benchmarks.foreign.case import Case
from benchmarks.foreign.robots import Array

Change = Callable[[Case], Streams]


@dataclass(frozen=True)
class Way:
    """How a healthy recording is broken.

    Args:
        change: what the driver would have recorded.
        words: pattern of a message, note or finding that says so; empty: none does.
        effect: name of the effect that it is; empty: none.
        harmless: an answer without an effect and without a word is right, too.
    """

    change: Change
    words: str = ""
    effect: str = ""
    harmless: bool = False


def frozen(values: Array) -> Array:
    """Readings (N, C) of which a quarter repeats one."""
    first = len(values) // 3
    values[first : first + len(values) // 4] = values[first]
    return values


def clipped(values: Array) -> Array:
    """Readings (N, C) of which a tenth in each channel is at a limit of its own."""
    most = np.quantile(np.abs(values), 0.9, axis=0)
    return np.clip(values, -most, most)
