"""Goals that wait until the robot is known, instead of failing."""

import math
from collections.abc import Callable
from typing import Any

from poise.errors import ErrorCode, InputError, PoiseError
from poise.nodes.clock import node_seconds
from poise.nodes.parameters import Parameter
from poise.nodes.runtime import coded
from poise.nodes.watchdog import WatchedGoal

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
FEEDBACK_PERIOD = 0.1
"""s between two feedbacks of a goal."""


class Readiness:
    """What one goal waits for.

    Args:
        patience: s.
    """

    def __init__(self, patience: float) -> None:
        self.begun = node_seconds()
        """On `node_seconds`."""
        self._until = self.begun + patience

    def may_change(self, error: PoiseError) -> bool:
        """Whether to try again later: the reason may go away, and there is time left."""
        return error.code in _PASSING and node_seconds() < self._until


class WaitingGoal:
    """The accepted goal of an action that has not begun yet, if there is one.

    Args:
        begin: begins with a goal that was accepted at s of `node_seconds`; raises what is wrong or missing.
        conclude: makes the result of a goal that ends before it begins, and sets its status.
        cancelled: the error of a goal that is cancelled before it begins.
        feedback: what its caller receives while it waits.
    """

    def __init__(
        self,
        begin: Callable[[WatchedGoal, float], None],
        conclude: Callable[[WatchedGoal, PoiseError], Any],
        cancelled: Callable[[WatchedGoal], PoiseError],
        feedback: Any,
    ) -> None:
        self._begin, self._conclude, self._cancelled, self._feedback = begin, conclude, cancelled, feedback
        self._readiness, self._last_feedback = Readiness(0.0), 0.0
        self.goal: WatchedGoal | None = None

    def take(self, goal: WatchedGoal, patience: float) -> None:
        """Begin with a goal now, or within s of patience."""
        self.goal, self._readiness = goal, Readiness(patience)
        self.tick()

    def tick(self) -> None:
        """Begin with the goal that waits, if what it needs is there; publish feedback otherwise."""
        goal = self.goal
        if goal is None:
            return
        if goal.is_cancel_requested:
            self.refuse(self._cancelled(goal))
            return
        try:
            self._begin(goal, self._readiness.begun)
        except Exception as failure:  # of any kind: the caller must get an answer
            error = coded(failure)
            if not self._readiness.may_change(error):
                self.refuse(error)
            elif node_seconds() > self._last_feedback + FEEDBACK_PERIOD:
                self._last_feedback = node_seconds()
                goal.publish_feedback(self._feedback)
            return
        self.goal = None

    def refuse(self, error: PoiseError) -> None:
        """End the goal that waits, if there is one."""
        goal, self.goal = self.goal, None
        if goal is not None:
            goal.execute(lambda handle: self._conclude(handle, error))


def seconds_of(goal: WatchedGoal, usual: float) -> float:
    """The deadline of a goal, s; its own, or the usual one of the node where it gives 0.

    Raises:
        InputError: BAD_INPUT, when it is negative or not finite.
    """
    seconds = float(goal.request.deadline or usual)
    if not 0 < seconds < math.inf:
        raise InputError(ErrorCode.BAD_INPUT, f"goal: deadline {goal.request.deadline} s; give 0 for the node's")
    return seconds
