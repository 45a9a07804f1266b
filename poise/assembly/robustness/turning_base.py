"""How the base under an assembly is tilted and turns, from parameters or from odometry."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.geometry import rotation_of_quaternion
from poise.types import Array

SMOOTHING = 0.2
"""s: time constant of the angular speed before it is differentiated."""
_FASTEST = 100.0
"""rad/s that the speed of a base may be; one that is far beyond would outlast the smoothing by minutes."""


@dataclass(frozen=True, eq=False)
class TurningBase:
    """How a base is tilted and turns.

    Args:
        up: (3,) what is upwards, in the base's frame.
        speed: rad/s about its z axis.
        acceleration: rad/s2.
    """

    up: Array
    speed: float = 0.0
    acceleration: float = 0.0

    @classmethod
    def tilted(cls, roll: float, pitch: float, speed: float, acceleration: float) -> "TurningBase":
        """A base turned by pitch about y, then by roll about x (REP-103), rad."""
        up = [-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)]
        return cls(np.array(up), speed, acceleration)

    def gravity(self, level: Array) -> Array:
        """(3,) in the base's frame, of the gravity (3,) in the frame of the level base, by the shortest turn.

        Rodrigues' formula for the rotation that takes z to `up`; how the base is turned about the vertical is no
        matter to gravity, which is along z when level.
        """
        axis, cosine = np.cross([0.0, 0.0, 1.0], self.up), float(self.up[2])
        if cosine <= -1 + 1e-12:
            return -np.asarray(level)
        turned: Array = level + np.cross(axis, level) + np.cross(axis, np.cross(axis, level)) / (1 + cosine)
        return turned

    def tilt_from(self, other: "TurningBase") -> float:
        """Angle between what is upwards for two bases, rad."""
        return float(np.arctan2(np.linalg.norm(np.cross(self.up, other.up)), self.up @ other.up))

    def after(self, seconds: float, quaternion: ArrayLike, speed: float) -> "TurningBase":
        """As odometry says: the attitude (x y z w, world from base) and speed, rad/s, of `seconds` later.

        The speed is smoothed before it is differentiated; when time stands still or runs backwards the
        acceleration starts again from zero.

        Raises:
            InputError: NOT_FINITE, also for a speed above 100 rad/s.
        """
        turn = np.asarray(quaternion, dtype=np.float64)
        if not (np.isfinite(turn).all() and abs(speed) <= _FASTEST and abs(np.linalg.norm(turn) - 1) < 1e-2):
            raise InputError(ErrorCode.NOT_FINITE, f"odom: the attitude {turn} or the speed {speed} is none")
        up = rotation_of_quaternion(turn)[2]
        if seconds <= 0:
            return TurningBase(up, speed)
        share = 1 - np.exp(-seconds / SMOOTHING)
        smooth = self.speed + share * (speed - self.speed)
        return TurningBase(up, smooth, (smooth - self.speed) / seconds)
