"""A simulated gripper: one joint that follows its command, with a limited speed."""

import numpy as np

from poise.types import Array


class SimulatedGripper:
    """It grasps nothing, so nothing stops it on its way.

    Args:
        joint: its name.
        speed: rad/s or m/s.
    """

    def __init__(self, joint: str, speed: float) -> None:
        self.joint, self._speed = joint, speed
        self.reset()

    def reset(self) -> None:
        """Be at zero, at the beginning."""
        self._way = (0.0, 0.0, 0.0)  # from, to, since; one assignment, for the player's thread reads it

    def go(self, target: float, seconds: float) -> None:
        """Go somewhere, from `seconds` after the beginning on."""
        self._way = (float(self.at(np.array([seconds]))[0][0]), target, seconds)

    def at(self, seconds: Array) -> tuple[Array, Array, Array]:
        """(N,) position, velocity and effort."""
        begin, end, since = self._way
        run = end - begin
        covered = self._speed * np.maximum(seconds - since, 0.0)
        moves = (covered > 0) & (covered < abs(run))
        position = begin + np.sign(run) * np.minimum(covered, abs(run))
        return position, np.sign(run) * self._speed * moves, np.zeros_like(position)
