"""A gripper on its controller: which position of its joint is which opening, and when its fingers have stopped."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

_NEAR = 0.05
"""Of the whole way: nearer than that, the fingers are at the commanded position."""
_STILL = 0.01
"""Of the whole way: within it a resting joint stays,"""
_REST = 0.2
"""s for which it has to, to count as resting."""


@dataclass(frozen=True)
class Gripper:
    """One joint whose position is in proportion to the opening.

    The defaults are those of a Robotiq 2F-85, whose opening is nearly in proportion.

    Args:
        joint: its name.
        opened, closed: rad or m, its position with the fingers `stroke` apart, and together.
        stroke: m.
        squeeze: m by which the commanded position closes beyond the grasped width, so that the fingers press.
        seconds: in which they open or close.
    """

    joint: str = "robotiq_85_left_knuckle_joint"
    opened: float = 0.0
    closed: float = 0.8
    stroke: float = 0.085
    squeeze: float = 0.005
    seconds: float = 1.0

    def position(self, opening: float, gripping: bool) -> float:
        """rad or m, of the joint for an opening, m."""
        wanted = opening - self.squeeze if gripping else opening
        return self.closed + (self.opened - self.closed) * float(np.clip(wanted / self.stroke, 0.0, 1.0))

    @property
    def travel(self) -> float:
        """rad or m, the whole way."""
        return abs(self.closed - self.opened)


class FingerWatch:
    """The position of the fingers, where joint states contain it.

    Args:
        gripper: whose.
    """

    def __init__(self, gripper: Gripper) -> None:
        self._gripper = gripper
        self.position: float | None = None
        self.heard = -np.inf
        """s, time of the last joint state with the joint."""
        self._rests_at, self._since = np.inf, 0.0

    def add(self, names: Sequence[str], position: ArrayLike, now: float) -> None:
        """Take a joint state; one without the gripper's joint is left out."""
        value = dict(zip(names, np.asarray(position, dtype=np.float64).tolist(), strict=False)).get(self._gripper.joint)
        if value is None or not np.isfinite(value):
            return
        if abs(value - self._rests_at) > _STILL * self._gripper.travel:
            self._rests_at, self._since = value, now
        self.position, self.heard = value, now

    def stopped(self, now: float) -> bool:
        """They have not moved for a while."""
        return now - self._since > _REST

    def near(self, target: float) -> bool:
        """They are at the commanded position."""
        return self.position is not None and abs(self.position - target) <= _NEAR * self._gripper.travel

    def kept_open(self, target: float) -> float:
        """Share of the squeeze by which what they hold keeps them from the position that grips it, rad or m.

        Infinite when the position is not known, or the squeeze is too small to measure.
        """
        squeeze = self._gripper.squeeze / self._gripper.stroke * self._gripper.travel
        if self.position is None or squeeze < 2 * _STILL * self._gripper.travel:
            return np.inf
        return abs(self.position - target) / squeeze

    def moved(self, before: float | None) -> bool:
        """They are not where they were before."""
        if self.position is None or before is None:
            return False
        return abs(self.position - before) > _STILL * self._gripper.travel
