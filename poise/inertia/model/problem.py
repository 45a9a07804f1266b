"""The question every identification method answers: wrenches, kinematics, noise, and what is known of the shape."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.geometry import GRAVITY_IN_WORLD
from poise.inertia.model.wrench_regressor import regressor
from poise.robot import SensorMotion
from poise.types import Array


@dataclass(frozen=True)
class NoiseLevels:
    """Standard deviations per axis; the defaults are the moderate level of thesis tables 3.2 and 3.7.

    The first four are white noise of one sample. The last two are the spread of a constant: what the sensor may read
    with nothing on it. Zero means that the sensor was zeroed without its load, infinity that nothing is known.
    NaN marks a level that has to be estimated from the samples.

    Args:
        force: N.
        torque: N m.
        linear_acceleration: m/s2.
        angular_acceleration: rad/s2.
        force_bias: N.
        torque_bias: N m.
        zeroed: spread of the constant that a zeroed sensor still reads, as a share of the two above: 0 where the device
            zeroed itself, more where an estimate gave the bias that was taken out.
    """

    force: float = 0.1
    torque: float = 0.005
    linear_acceleration: float = 0.05
    angular_acceleration: float = 0.5
    force_bias: float = 0.0
    torque_bias: float = 0.0
    zeroed: float = 0.0

    @property
    def has_bias(self) -> bool:
        """The sensor may read something with nothing on it."""
        return self.force_bias > 0 or self.torque_bias > 0

    def filled(self, other: "NoiseLevels") -> "NoiseLevels":
        """With the levels of another where this one has NaN."""
        names = [each.name for each in fields(self) if np.isnan(getattr(self, each.name))]
        return replace(self, **{name: getattr(other, name) for name in names})

    @property
    def wrench(self) -> Array:
        """(6,) standard deviations of force and torque samples, N and N m."""
        return np.repeat([self.force, self.torque], 3)


UNKNOWN_NOISE = NoiseLevels(*[np.nan] * 6)
"""The samples have to show the noise, and nothing is known of the bias."""


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """Samples of a load's wrench and of its motion, one row per stamp, everything in sensor axes.

    The wrench is what the load exerts ON the sensor, at the sensor's origin (see `regressor`).

    Args:
        stamps: (N,) int64 ns, increasing; those of the kinematics and of the wrench alike.
        gravity_in_sensor: (N, 3) m/s2.
        linear_acceleration: (N, 3) m/s2, coordinate acceleration of the sensor's origin, without gravity.
        angular_velocity: (N, 3) rad/s.
        angular_acceleration: (N, 3) rad/s2.
        wrench: (N, 6) N and N m.
        noise: how far all of these may be trusted.
        unit_parts: (10, K) phi of each part of the object, of homogeneous density, at 1 kg; None when unknown.
        part_volumes: (K,) m3; None when unknown.
        shape_points: (P, 3) m, points spread evenly inside the object; None when unknown.

    Raises:
        InputError: TYPE_MISMATCH when shapes do not belong together, NOT_FINITE for NaN or infinity,
            BAD_INPUT for stamps that do not increase or volumes that are not positive.
    """

    stamps: NDArray[np.int64]
    gravity_in_sensor: Array
    linear_acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array
    wrench: Array
    noise: NoiseLevels = NoiseLevels()
    unit_parts: Array | None = None
    part_volumes: Array | None = None
    shape_points: Array | None = None

    def __post_init__(self) -> None:
        stamps = _frozen(self.stamps, np.int64)
        object.__setattr__(self, "stamps", stamps)
        if stamps.ndim != 1 or np.any(np.diff(stamps) <= 0):
            raise InputError(
                ErrorCode.BAD_INPUT, "identification problem: stamps must be one row of increasing nanoseconds; sort"
            )
        n = len(stamps)
        for name in _KINEMATICS:
            self._check(name, (n, 3))
        self._check("wrench", (n, 6))
        n_parts = 0 if self.unit_parts is None else np.shape(self.unit_parts)[-1]
        n_points = 0 if self.shape_points is None else np.shape(self.shape_points)[0]
        optional: dict[str, tuple[int, ...]] = {
            "unit_parts": (10, n_parts),
            "part_volumes": (n_parts,),
            "shape_points": (n_points, 3),
        }
        for name, shape in optional.items():
            if getattr(self, name) is not None:
                self._check(name, shape)
        if self.part_volumes is not None and np.any(self.part_volumes <= 0):
            raise InputError(ErrorCode.BAD_INPUT, "identification problem: part_volumes must be positive (m3)")

    def _check(self, name: str, shape: tuple[int, ...]) -> None:
        value = _frozen(getattr(self, name), np.float64)
        object.__setattr__(self, name, value)
        if value.shape != shape:
            raise InputError(
                ErrorCode.TYPE_MISMATCH, f"identification problem: {name} has shape {value.shape}, expected {shape}"
            )
        if not np.all(np.isfinite(value)):
            bad = int(np.argwhere(~np.isfinite(value))[0][0])
            raise InputError(
                ErrorCode.NOT_FINITE,
                f"identification problem: {name} is not finite at row {bad}; leave such samples out",
                row=bad,
            )

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def seconds(self) -> Array:
        """(N,) s since the first stamp."""
        return np.asarray((self.stamps - self.stamps[0]) * 1e-9) if len(self) else np.zeros(0)

    @property
    def gravity_minus_acceleration(self) -> Array:
        """(N, 3) m/s2, what a hanging mass at the sensor's origin feels."""
        return self.gravity_in_sensor - self.linear_acceleration

    @cached_property
    def regressor(self) -> Array:
        """(N, 6, 10) A with wrench = A phi, thesis eq. 3.2."""
        matrix = regressor(self.gravity_minus_acceleration, self.angular_velocity, self.angular_acceleration)
        matrix.flags.writeable = False
        return matrix

    def select(self, mask: Any) -> "IdentificationProblem":
        """The samples that a boolean mask, an index array or a slice picks."""
        rows = {name: getattr(self, name)[mask] for name in ("stamps", "wrench", *_KINEMATICS)}
        return replace(self, **rows)

    @classmethod
    def from_motion(
        cls, motion: SensorMotion, wrench: ArrayLike, gravity: ArrayLike = GRAVITY_IN_WORLD, **known: Any
    ) -> "IdentificationProblem":
        """Samples of a recording: a motion, the wrench at its stamps (N, 6), and what else is `known`."""
        return cls(
            stamps=motion.stamps,
            gravity_in_sensor=motion.gravity_in_sensor(gravity),
            linear_acceleration=motion.linear_acceleration_in_sensor,
            angular_velocity=motion.angular_velocity_in_sensor,
            angular_acceleration=motion.angular_acceleration_in_sensor,
            wrench=np.asarray(wrench, dtype=np.float64),
            **known,
        )


_KINEMATICS = ("gravity_in_sensor", "linear_acceleration", "angular_velocity", "angular_acceleration")
"""Fields of a problem with one 3-vector per sample."""


def _frozen(value: ArrayLike, dtype: Any) -> Any:
    array = np.array(value, dtype=dtype)
    array.flags.writeable = False
    return array
