"""How the sensor moved: its attitude, angular velocity and accelerations over a recording."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.geometry import GRAVITY_IN_WORLD
from poise.types import Array


@dataclass(frozen=True)
class SensorMotion:
    """Motion of a sensor frame against an inertial world, sampled.

    Args:
        stamps: (N,) int64 ns.
        rotation_world_sensor: (N, 3, 3), takes sensor axes to world axes.
        angular_velocity_in_sensor: (N, 3) rad/s.
        angular_acceleration_in_sensor: (N, 3) rad/s2.
        linear_acceleration_in_sensor: (N, 3) m/s2, coordinate acceleration of the sensor's origin, in sensor axes,
            WITHOUT gravity (zero at rest; an accelerometer would read this minus `gravity_in_sensor`).

    Raises:
        InputError: TYPE_MISMATCH when the shapes do not belong together.
    """

    stamps: NDArray[np.int64]
    rotation_world_sensor: Array
    angular_velocity_in_sensor: Array
    angular_acceleration_in_sensor: Array
    linear_acceleration_in_sensor: Array

    def __post_init__(self) -> None:
        n = len(self.stamps)
        shapes = {"stamps": (n,), "rotation_world_sensor": (n, 3, 3)}
        for field in fields(self):
            dtype = np.int64 if field.name == "stamps" else np.float64
            value = np.asarray(getattr(self, field.name), dtype=dtype).view()
            expected = shapes.get(field.name, (n, 3))
            if value.shape != expected:
                raise InputError(
                    ErrorCode.TYPE_MISMATCH,
                    f"sensor motion: {field.name} has shape {value.shape}, expected {expected} for {n} stamps",
                )
            value.flags.writeable = False
            object.__setattr__(self, field.name, value)

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def seconds(self) -> Array:
        """(N,) s since the first stamp."""
        return np.asarray((self.stamps - self.stamps[0]) * 1e-9) if len(self) else np.zeros(0)

    def gravity_in_sensor(self, gravity: ArrayLike = GRAVITY_IN_WORLD) -> Array:
        """(N, 3) m/s2: the world's gravity vector in sensor axes."""
        return np.asarray(np.asarray(gravity, dtype=np.float64) @ self.rotation_world_sensor)

    def select(self, mask: Any) -> "SensorMotion":
        """The samples that a boolean mask, an index array or a slice picks."""
        return SensorMotion(*(getattr(self, field.name)[mask] for field in fields(self)))

    @classmethod
    def at_rest(cls, stamps: ArrayLike, rotation_world_sensor: ArrayLike) -> "SensorMotion":
        """Poses held still, (N,) ns and (N, 3, 3): every velocity and acceleration is zero."""
        zeros = np.zeros((np.asarray(stamps).shape[0], 3))
        return cls(np.asarray(stamps), np.asarray(rotation_world_sensor), zeros, zeros, zeros)
