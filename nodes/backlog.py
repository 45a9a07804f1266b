"""Queues of subscriptions that were full: the middleware drops their oldest messages and does not say so."""

import functools
from collections import Counter
from collections.abc import Callable
from typing import Any


class Backlog:
    """Counts how often a queue was full. rmw_fastrtps does not report such messages as lost.

    A node that was held up takes all that waited before its next timer. If these are as many messages as the queue
    holds, it was full.

    Args:
        depth: of each queue.
    """

    def __init__(self, depth: int) -> None:
        self.depth = depth
        self.overflows = 0
        """Full queues so far."""
        self._taken: Counter[str] = Counter()

    def counted(self, topic: str, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """The callback, with its messages counted."""

        @functools.wraps(callback)
        def take(message: Any) -> None:
            self._taken[topic] += 1
            callback(message)

        return take

    def full(self) -> list[str]:
        """Topics whose queue was full since the last call; to be called by a timer."""
        found = [topic for topic, count in self._taken.items() if count >= self.depth]
        self.overflows += len(found)
        self._taken.clear()
        return found
