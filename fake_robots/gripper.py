"""A simulated gripper: one joint that follows its command with a limited speed, until a body stops its fingers."""

from dataclasses import dataclass

import numpy as np

from poise.types import Array


@dataclass(frozen=True)
class FingerTravel:
    """Which position of the joint is which opening, in proportion; the defaults are those of a Robotiq 2F-85.

    Args:
        opened, closed: rad or m, of the joint with the fingers `stroke` apart, and together.
        stroke: m.
        force: N with which the fingers press on a body.
    """

    opened: float = 0.0
    closed: float = 0.8
    stroke: float = 0.085
    force: float = 100.0

    def opening(self, position: float) -> float:
        """m between the fingers."""
        return float(np.clip((self.closed - position) / (self.closed - self.opened), 0.0, 1.0)) * self.stroke

    def position(self, opening: float) -> float:
        """rad or m, of the joint."""
        return self.closed + (self.opened - self.closed) * opening / self.stroke


class SimulatedGripper:
    """A joint with two fingers.

    Args:
        joint: its name.
        speed: rad/s or m/s.
        travel: of its fingers.
    """

    def __init__(self, joint: str, speed: float, travel: FingerTravel | None = None) -> None:
        self.joint, self._speed = joint, speed
        self.travel = travel or FingerTravel()
        self.reset()

    def reset(self) -> None:
        """Be at zero, at the beginning."""
        self._way = (0.0, 0.0, 0.0)  # from, to, since; one assignment, for the player's thread reads it
        self._stop: float | None = None  # position at which a body stops the fingers
        self._force = self.travel.force

    def go(self, target: float, seconds: float, force: float = 0.0) -> None:
        """Go somewhere, from `seconds` after the beginning on; press with a force, N, or (0) with its own."""
        self._way = (float(self.at(np.array([seconds]))[0][0]), target, seconds)
        self._force = force or self.travel.force

    def stop_at(self, opening: float | None) -> None:
        """A body stops the fingers at an opening, m; None: nothing does."""
        self._stop = None if opening is None else self.travel.position(opening)

    @property
    def target(self) -> float:
        """Where it was sent, rad or m."""
        return self._way[1]

    def force(self, seconds: float) -> float:
        """N with which the fingers press on what stops them; 0 when they do not try to close."""
        position = float(self.at(np.array([seconds]))[0][0])
        return self._force if (self.target - position) * (self.travel.closed - self.travel.opened) > 0 else 0.0

    def at(self, seconds: Array) -> tuple[Array, Array, Array]:
        """(N,) position, velocity and effort; the effort is the force of the fingers, N."""
        begin, end, since = self._way
        run = end - begin
        covered = self._speed * np.maximum(seconds - since, 0.0)
        moves = (covered > 0) & (covered < abs(run))
        position = begin + np.sign(run) * np.minimum(covered, abs(run))
        effort = np.zeros_like(position)
        if self._stop is not None:
            closing = np.sign(self.travel.closed - self.travel.opened)
            blocked = (position - self._stop) * closing > 0
            position = np.where(blocked, self._stop, position)
            moves = moves & ~blocked
            effort = np.where(blocked, self._force, 0.0)
        return position, np.sign(run) * self._speed * moves, effort
