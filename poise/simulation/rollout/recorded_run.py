"""What of a recording a free run needs: the joints' motion, and what was commanded or exerted."""

from dataclasses import dataclass

import numpy as np

from poise.types import Array


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """Joints of a recording.

    Args:
        names: (J).
        seconds: (N,) ascending.
        position, velocity: (N, J) rad or m, smoothed.
        measured_velocity: (N, J) as recorded; NaN where it was not.
        effort: (N, J) N m or N that the joints exerted; NaN where it was not measured.
        command_seconds: (K,) of the commands, on the same clock.
        command, command_velocity: (K, J); NaN of joints that were not commanded.
        wrench_seconds, wrench: (M,), (M, 6) of the load on the sensor, sensor axes; None without a sensor.
        frame: of that sensor.
    """

    names: tuple[str, ...]
    seconds: Array
    position: Array
    velocity: Array
    measured_velocity: Array
    effort: Array
    command_seconds: Array
    command: Array
    command_velocity: Array
    wrench_seconds: Array | None = None
    wrench: Array | None = None
    frame: str | None = None

    def position_at(self, seconds: Array) -> Array:
        """(..., J) the recorded positions at some seconds (...)."""
        return _at(self.seconds, self.position, seconds)

    def velocity_at(self, seconds: Array) -> Array:
        """(..., J) likewise."""
        return _at(self.seconds, self.velocity, seconds)

    def effort_at(self, seconds: Array, joint: int) -> Array:
        """(...) of one joint, linear between samples."""
        return np.asarray(np.interp(seconds, self.seconds, self.effort[:, joint]))

    def command_at(self, seconds: Array, joint: int, rate: bool = False) -> Array:
        """(...) the last command of a joint that was sent before; before the first one, the first."""
        row = np.searchsorted(self.command_seconds, seconds + 1e-9, side="right") - 1
        return np.asarray((self.command_velocity if rate else self.command)[np.maximum(row, 0), joint])

    def wrench_at(self, seconds: Array) -> Array:
        """(..., 6); NaN without a sensor."""
        if self.wrench is None or self.wrench_seconds is None:
            return np.full((*np.shape(seconds), 6), np.nan)
        return _at(self.wrench_seconds, self.wrench, seconds)


def _at(known: Array, values: Array, seconds: Array) -> Array:
    return np.stack([np.interp(seconds, known, column) for column in values.T], axis=-1)
