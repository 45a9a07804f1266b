"""What a model returns: for each question the load factor at collapse, its bounds, and the mechanism."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from poise.types import Array, Indices, Mask


class Movement(Protocol):
    """A motion of objects at collapse; see `Mechanism`."""

    @property
    def velocities(self) -> dict[int, Array]:
        """For each object that moves, its place in `Assembly.objects`: (6,) velocity of its com, angular velocity."""

    @property
    def mode(self) -> str:
        """slip, topple, roll or mixed."""


@dataclass(frozen=True)
class PlainMovement:
    """A motion given by its velocities."""

    velocities: dict[int, Array]
    mode: str


@dataclass(eq=False)
class LimitLoads:
    """For each question bounds on the load factor at which something moves, and the motion.

    Args:
        lower, upper: (Q,) inf where nothing moves at any factor.
        mechanisms: the first to occur, None where nothing moves.
        checked: (Q,) whether elastic contacts confirmed or lowered the answer.
        complete: the deadline left time for all questions.
    """

    lower: Array
    upper: Array
    mechanisms: list[Movement | None]
    checked: Mask
    complete: bool = True

    @classmethod
    def start(cls, count: int) -> "LimitLoads":
        """Start with no mechanism for any question."""
        never = np.full(count, np.inf)
        return cls(never, never.copy(), [None] * count, np.zeros(count, dtype=bool))

    def limit_by(self, question: int, lower: float, upper: float, mechanism: Movement) -> None:
        """Record that a mechanism occurs for a question at a load factor between these bounds."""
        if upper < self.upper[question]:
            self.upper[question] = upper
            self.mechanisms[question] = mechanism
        self.lower[question] = min(self.lower[question], lower)

    def limit_by_all(
        self, questions: Indices, lower: Array, upper: Array, mechanism: Callable[[int], Movement]
    ) -> None:
        """The same for different questions (q,) at once; `mechanism` is called with the rows at which one is kept."""
        for row in np.flatnonzero(upper < self.upper[questions]).tolist():
            self.mechanisms[questions[row]] = mechanism(row)
        self.upper[questions] = np.minimum(self.upper[questions], upper)
        self.lower[questions] = np.minimum(self.lower[questions], lower)

    def give_up(self, questions: NDArray[np.int64]) -> None:
        """Record that there was no time for these questions: their lower bounds become 0."""
        self.complete = False
        self.lower[questions] = 0.0
