"""Frames that hang on the hand, as tf tells of them: where a shape is, or an IMU, that has a frame of its own."""

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.types import Array


class HandFrames:
    """The newest transform of every frame to its parent."""

    def __init__(self) -> None:
        self._above: dict[str, tuple[str, Array, Array]] = {}
        self._fixed: set[str] = set()

    def add(self, parent: str, child: str, rotation: ArrayLike, translation: ArrayLike, *, fixed: bool = False) -> None:
        """Take x_parent = rotation (3, 3) @ x_child + translation (3,) m; `fixed` when it comes from tf_static."""
        turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
        if np.isfinite(turn).all() and np.isfinite(shift).all():
            self._above[child] = parent, turn, shift
            self._fixed.add(child) if fixed else self._fixed.discard(child)

    def pose(self, frame: str, sensor_frame: str) -> tuple[Array, Array]:
        """Rotation (3, 3) and translation (3,) m of a frame in the sensor's.

        Raises:
            InputError: FRAME_UNKNOWN when tf tells of no way from the one up to the other.
        """
        rotation, translation, at, seen = np.eye(3), np.zeros(3), frame, {frame}
        while at != sensor_frame:
            if at not in self._above or self._above[at][0] in seen:
                raise InputError(
                    ErrorCode.FRAME_UNKNOWN,
                    f"tf tells of no way from {frame} up to {sensor_frame or 'the sensor'}, but only to {at}: publish"
                    " where the object is in the hand, or give its shape in the sensor frame",
                )
            at, turn, shift = self._above[at]
            rotation, translation = turn @ rotation, turn @ translation + shift
            seen.add(at)
        return rotation, translation

    def mounting(self, frame: str, sensor_frame: str) -> tuple[Array, Array] | None:
        """Rotation (3, 3) and translation (3,) m of a frame in the sensor's when tf_static joins them; else None."""
        of_frame, of_sensor = self._fixed_to(frame), self._fixed_to(sensor_frame)
        for name, (turn, shift) in of_frame.items():
            if name in of_sensor:
                sensor_turn, sensor_shift = of_sensor[name]
                return sensor_turn.T @ turn, sensor_turn.T @ (shift - sensor_shift)
        return None

    def _fixed_to(self, frame: str) -> dict[str, tuple[Array, Array]]:
        """Every frame that this one is fixed to on the way up, itself first, and where it is in that."""
        found = {frame: (np.eye(3), np.zeros(3))}
        while frame in self._fixed and self._above[frame][0] not in found:
            parent, turn, shift = self._above[frame]
            rotation, translation = found[frame]
            found[parent] = turn @ rotation, turn @ translation + shift
            frame = parent
        return found
