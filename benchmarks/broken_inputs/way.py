"""A way in which a driver may be wrong, and what may be said of it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from benchmarks.foreign.bag import Streams
from benchmarks.foreign.case import Case
from benchmarks.foreign.robots import Array

T = TypeVar("T")
Change = Callable[[Case], Streams]


class Written(Protocol):
    """A recording with its model that can be written."""

    def write(self, folder: Path) -> None:
        """Write both into a new folder."""


@dataclass(frozen=True)
class Way:
    """How a healthy recording is broken.

    Args:
        change: what would have been recorded, or written; None where the way does not apply.
        words: pattern of a message, note, finding or sentence of an effect that says so; empty: none does.
        effect: name of the effect that it is; empty: none.
        harmless: an answer without an effect and without a word is right, too.
    """

    change: Callable[[Case], Streams | Written | None]
    words: str = ""
    effect: str = ""
    harmless: bool = False

    def broken(self, case: Case) -> Written | None:
        """The broken recording with its model; None where the way does not apply."""
        changed = self.change(case)
        return replace(case, streams=changed) if isinstance(changed, Streams) else changed


def turning(change: Callable[[Case], T]) -> Callable[[Case], T | None]:
    """Of robots that turn the load: slides feel masses alone."""
    return lambda case: change(case) if "revolute" in case.streams.robot_description else None


def frozen(values: Array) -> Array:
    """Readings (N, C) of which a quarter repeats one."""
    first = len(values) // 3
    values[first : first + len(values) // 4] = values[first]
    return values


def clipped(values: Array) -> Array:
    """Readings (N, C) of which a tenth in each channel is at a limit of its own."""
    most = np.quantile(np.abs(values), 0.9, axis=0)
    return np.clip(values, -most, most)
