"""A way in which a driver may be wrong, and what may be said of it."""

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.foreign.bag import Streams
from benchmarks.foreign.case import Case

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
