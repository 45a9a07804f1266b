"""Nodes that follow the clock of a fake robot: simulated time waits for the slowest of them."""

import time
from collections.abc import Callable
from dataclasses import dataclass

_PATIENCE = 5.0
"""s of the machine that the clock waits for a node; then the node has ended, or hangs."""


@dataclass
class _Follower:
    heard: int
    """ns, the time that it has come to."""
    awaited: float | None = None
    """s of the machine since which the clock waits for it; None: it does not."""


class Followers:
    """How far each node has come that follows the clock. One that is silent for 5 s while it is awaited is left out,
    until it is heard again.

    Args:
        lead: s that the clock may be ahead of a node.
        warn: is called with a message about a node that is left out.
        between: s between two messages of a follower; the lead is at least twice that.
    """

    def __init__(self, lead: float, warn: Callable[[str], object], between: float = 0.0) -> None:
        self._lead, self._warn = round(max(lead, 2.0 * between) * 1e9), warn
        self._followers: dict[str, _Follower] = {}

    def heard(self, name: str, stamp: int) -> None:
        """A node says that it has come to a time, ns."""
        self._followers[name] = _Follower(stamp)

    def are_behind(self, stamp: int) -> bool:
        """Whether the clock has to wait before it comes to a time, ns."""
        now, behind = time.monotonic(), False
        for name, follower in list(self._followers.items()):  # `heard` is called in another thread
            if stamp - follower.heard <= self._lead:
                continue
            follower.awaited = follower.awaited or now
            if now - follower.awaited > _PATIENCE:
                self._followers.pop(name, None)
                self._warn(f"{name} has not followed /clock for {_PATIENCE:g} s; the clock goes on without it")
            else:
                behind = True
        return behind
