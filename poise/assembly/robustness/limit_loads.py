"""What a model answers: for each question when something gives way, between which bounds, and how."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from poise.types import Array, Mask


class Movement(Protocol):
    """How something gives way; see `Mechanism`."""

    @property
    def velocities(self) -> dict[int, Array]:
        """For each object that moves, its place in `Assembly.objects`: (6,) velocity of its com, angular velocity."""

    @property
    def mode(self) -> str:
        """slip, topple or mixed."""


@dataclass(frozen=True)
class PlainMovement:
    """A movement that a model states outright."""

    velocities: dict[int, Array]
    mode: str


@dataclass(eq=False)
class LimitLoads:
    """For each question the factor at which something moves, bounds on it, and how it moves.

    Args:
        lower, upper: (Q,) inf where nothing ever moves.
        mechanisms: what gives way first, None where nothing does.
        checked: (Q,) whether elastic contacts were asked too.
        complete: nothing was left out for want of time.
    """

    lower: Array
    upper: Array
    mechanisms: list[Movement | None]
    checked: Mask
    complete: bool = True

    @classmethod
    def start(cls, count: int) -> "LimitLoads":
        """Before any block is asked nothing moves."""
        never = np.full(count, np.inf)
        return cls(never, never.copy(), [None] * count, np.zeros(count, dtype=bool))

    def limit_by(self, question: int, lower: float, upper: float, mechanism: Movement) -> None:
        """Record that something gives way to a question at a factor between these."""
        if upper < self.upper[question]:
            self.upper[question] = upper
            self.mechanisms[question] = mechanism
        self.lower[question] = min(self.lower[question], lower)

    def give_up(self, questions: NDArray[np.int64]) -> None:
        """There was no time for these: nothing is known of them from below."""
        self.complete = False
        self.lower[questions] = 0.0
