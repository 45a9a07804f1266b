"""Goals that wait until the robot is known, instead of failing."""

import time

from poise.errors import ErrorCode, PoiseError
from poise.nodes.parameters import Parameter

READY_TIMEOUT = Parameter(
    "ready_timeout",
    10.0,
    "s that a goal waits for the robot, its controllers and its sensors",
    (0.0, 600.0),
    dynamic=True,
)
_PASSING = (
    ErrorCode.TOPIC_MISSING,
    ErrorCode.ROBOT_DESCRIPTION_MISSING,
    ErrorCode.FRAME_UNKNOWN,
    ErrorCode.EMPTY,
)
"""Codes of what may still come."""


class Readiness:
    """What one goal waits for.

    Args:
        patience: s.
    """

    def __init__(self, patience: float) -> None:
        self.begun = time.monotonic()
        """On the monotonic clock, s."""
        self._until = self.begun + patience

    def may_change(self, error: PoiseError) -> bool:
        """Whether to try again later: the reason may go away, and there is time left."""
        return error.code in _PASSING and time.monotonic() < self._until
