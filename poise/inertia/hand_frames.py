"""Frames that hang on the hand, as tf tells of them: where a shape is that was given in a frame of its own."""

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.inertia.parameters import Array


class HandFrames:
    """The newest transform of every frame to its parent."""

    def __init__(self) -> None:
        self._above: dict[str, tuple[str, Array, Array]] = {}

    def add(self, parent: str, child: str, rotation: ArrayLike, translation: ArrayLike) -> None:
        """Take x_parent = rotation (3, 3) @ x_child + translation (3,) m."""
        turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
        if np.isfinite(turn).all() and np.isfinite(shift).all():
            self._above[child] = parent, turn, shift

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
