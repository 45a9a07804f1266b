"""A gripper on its controller: which position of its joint is which opening, and when its fingers have stopped."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

_NEAR = 0.05
"""Of the whole way: nearer than that, the fingers are at the commanded position."""
_STILL = 0.01
"""Of the whole way: within it a resting joint stays,"""
_REST = 0.2
"""s for which it has to, to count as resting."""
_KEPT, _THROUGH = 0.5, 0.4
"""Share of the squeeze by which an object keeps the fingers open at least; share of that which remains without it."""


class Grip(NamedTuple):
    """How fingers hold something.

    Args:
        commanded: m, opening that they were commanded to.
        kept_open: m by which what they hold keeps them wider; NaN: not known.
    """

    commanded: float
    kept_open: float


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

    def opening(self, position: float) -> float:
        """m between the fingers, of a position of the joint; as `position` without a squeeze."""
        return (self.closed - position) / (self.closed - self.opened) * self.stroke

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

    def grip(self, target: float) -> Grip:
        """How they hold what stops them on their way to a position of the joint, rad or m."""
        commanded = self._gripper.opening(target)
        return Grip(commanded, np.nan if self.position is None else self._gripper.opening(self.position) - commanded)

    def shows(self, grip: Grip) -> bool:
        """Whether their position shows that what kept them open is gone, when it is.

        Not where it has kept them open by less than half of the squeeze, or by less than is measured well.
        """
        return grip.kept_open > max(_KEPT * self._gripper.squeeze, 2 * _STILL * self._gripper.stroke)

    def closed_through(self, grip: Grip) -> bool:
        """They have closed to where they were commanded to, by most of what an object had kept them open."""
        return self.grip(self._gripper.position(grip.commanded, False)).kept_open < _THROUGH * grip.kept_open

    def moved(self, before: float | None) -> bool:
        """They are not where they were before."""
        if self.position is None or before is None:
            return False
        return abs(self.position - before) > _STILL * self._gripper.travel
