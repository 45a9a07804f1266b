"""The time that a search may take, and its progress."""

import copy
import time
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass
class TimeLimit:
    """The time for a search; what is not done when it is over is left out.

    Args:
        seconds: that the search may take; infinite: no limit.
        progress: is called with the completed share, 0 to 1; None: nothing is shown.
        span: start and length of the search in that share.
        cut: something was left out.
    """

    seconds: float = float("inf")
    progress: Callable[[float], None] | None = None
    span: tuple[float, float] = (0.0, 1.0)
    cut: bool = field(default=False, init=False)
    _begin: float = field(default_factory=time.perf_counter, init=False)

    def over(self) -> bool:
        """Whether the time is over; once it is, the search counts as cut."""
        late = time.perf_counter() - self._begin > self.seconds
        self.cut = self.cut or late
        return late

    def extended(self, factor: float) -> "TimeLimit":
        """A limit for what follows: it began with this one and lasts longer; what was cut stays cut."""
        longer = copy.copy(self)
        longer.seconds *= factor
        return longer

    def passed(self, share: float) -> None:
        """Show a share of the search as completed."""
        if self.progress is not None:
            self.progress(self.span[0] + self.span[1] * share)
