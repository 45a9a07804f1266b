"""When to reconnect: exponential back-off with jitter."""

import numpy as np


class Backoff:
    """Waits that double from attempt to attempt and never pass the cap.

    Every wait is drawn from the upper half of its nominal length, so that several drivers do not reconnect in step.

    Args:
        rng: source of the jitter.
        first: s, the first nominal wait.
        cap: s, the longest. 0.8 s lets a sensor that returns be heard again within 1 s.
    """

    def __init__(self, rng: np.random.Generator, first: float = 0.05, cap: float = 0.8) -> None:
        self._rng = rng
        self._first = first
        self._cap = cap
        self._nominal = first

    def next(self) -> float:
        """The wait before the next attempt, s."""
        nominal = self._nominal
        self._nominal = min(2 * nominal, self._cap)
        return nominal * self._rng.uniform(0.5, 1.0)

    def reset(self) -> None:
        """An attempt worked: begin with the first wait again."""
        self._nominal = self._first
