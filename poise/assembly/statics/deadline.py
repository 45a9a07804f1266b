"""A deadline on the monotonic clock."""

import time
from dataclasses import dataclass
from numbers import Real

from poise.ranges import check_range


@dataclass(frozen=True)
class Deadline:
    """A time on the monotonic clock, s; None: no deadline."""

    at: float | None = None

    @classmethod
    def after(cls, seconds: float | None) -> "Deadline":
        """The deadline this many seconds from now; None: no deadline.

        Raises:
            InputError: BAD_INPUT unless it is a number in its range.
        """
        if seconds is None:
            return cls()
        check_range("deadline", seconds if isinstance(seconds, Real) else repr(seconds))
        return cls(time.monotonic() + seconds)

    @property
    def passed(self) -> bool:
        return self.at is not None and time.monotonic() >= self.at

    @property
    def remaining(self) -> float | None:
        """s until then, not negative; None: no deadline."""
        return None if self.at is None else max(0.0, self.at - time.monotonic())


NO_DEADLINE = Deadline()
