"""Streams in time, the values that a recording gives and the core computes on: frozen, stamped, in SI units."""

import math
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from poise.errors import ErrorCode, InputError
from poise.types import Array, Stamps


def stamp_of(message: Any) -> int:
    """ns, of any message with a header, decoded or live."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def flat_rows(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Reshape (N, ...) to (N, K), also when N is 0."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


@dataclass(frozen=True, eq=False)
class Stream:
    """What every stream has: stamps that never go backwards, and one row of each array per stamp.

    Arrays are copied in and read-only from then on; NaN marks what was not measured.

    Args:
        stamps: (N,) int64, nanoseconds of the clock that stamped the headers.

    Raises:
        InputError: TYPE_MISMATCH when an array has the wrong shape or the stamps are not integers,
            TIME_BACKWARDS when a stamp is smaller than the one before (equal stamps are allowed).
    """

    stamps: Stamps

    def __post_init__(self) -> None:
        stamps = np.asarray(self.stamps)
        if stamps.size and stamps.dtype.kind not in "iu":
            raise InputError(
                ErrorCode.TYPE_MISMATCH,
                f"{type(self).__name__}.stamps holds {stamps.dtype}: give integer nanoseconds",
            )
        self._freeze("stamps", np.int64, (stamps.size,))
        backwards = np.flatnonzero(np.diff(self.stamps) < 0)
        if backwards.size:
            index = int(backwards[0]) + 1
            raise InputError(
                ErrorCode.TIME_BACKWARDS,
                f"{type(self).__name__}.stamps goes backwards at sample {index}: sort the samples by stamp",
                index=index,
            )

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def seconds(self) -> Array:
        """(N,) seconds since the first stamp."""
        return np.asarray((self.stamps - self.stamps[:1]) * 1e-9, dtype=np.float64)

    @property
    def not_finite(self) -> int:
        """How many samples hold NaN or infinity, not counting columns that were never measured."""
        faulty = np.zeros(len(self), dtype=bool)
        for value in self.arrays().values():
            columns = flat_rows(value)
            faulty |= ~np.isfinite(columns[:, ~np.isnan(columns).all(axis=0)]).all(axis=1)
        return int(faulty.sum())

    def select(self, index: Any) -> Self:
        """Return the samples at `index`: a slice, a boolean mask (N,), or rising integers."""
        arrays: dict[str, Any] = {name: value[index] for name, value in self.arrays().items()}
        return replace(self, **arrays)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays by name: the stamps, and what has a row per stamp."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}

    def _freeze(self, name: str, dtype: type, shape: tuple[int, ...]) -> None:
        """Replace a field by a read-only copy of it with this type, once its shape is right."""
        try:
            array: npt.NDArray[Any] = np.array(getattr(self, name), dtype=dtype, order="C")
        except (TypeError, ValueError) as error:
            raise InputError(
                ErrorCode.TYPE_MISMATCH, f"{type(self).__name__}.{name} is not an array of numbers: {error}"
            ) from error
        if array.shape != shape:
            raise InputError(
                ErrorCode.TYPE_MISMATCH, f"{type(self).__name__}.{name} has shape {array.shape}: it must be {shape}"
            )
        array.setflags(write=False)
        object.__setattr__(self, name, array)


@dataclass(frozen=True, eq=False)
class WrenchStream(Stream):
    """What the load exerts on the sensor, in the sensor frame at its origin.

    Args:
        stamps: (N,) int64 ns.
        wrench_in_sensor: (N, 6) force [N], torque [N m].
        frame_id: the sensor frame.
    """

    wrench_in_sensor: Array
    frame_id: str

    def __post_init__(self) -> None:
        super().__post_init__()
        self._freeze("wrench_in_sensor", np.float64, (len(self), 6))


@dataclass(frozen=True, eq=False)
class JointStream(Stream):
    """Joint states; what a message left out is NaN.

    Args:
        stamps: (N,) int64 ns.
        names: J joint names, in the order of the columns.
        position: (N, J) rad (m for prismatic joints).
        velocity: (N, J) rad/s.
        effort: (N, J) N m.
    """

    names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "names", tuple(self.names))
        for name in ("position", "velocity", "effort"):
            self._freeze(name, np.float64, (len(self), len(self.names)))


@dataclass(frozen=True, eq=False)
class PoseStream(Stream):
    """Where a child frame is in its parent: x_parent = rotation @ x_child + translation.

    Args:
        stamps: (N,) int64 ns.
        rotation_parent_child: (N, 3, 3).
        translation_parent_child: (N, 3) m.
        parent: frame name.
        child: frame name.
        twist_in_child: (N, 6) m/s and rad/s of the child in its own axes; None where it was not measured.
    """

    rotation_parent_child: Array
    translation_parent_child: Array
    parent: str
    child: str
    twist_in_child: Array | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._freeze("rotation_parent_child", np.float64, (len(self), 3, 3))
        self._freeze("translation_parent_child", np.float64, (len(self), 3))
        if self.twist_in_child is not None:
            self._freeze("twist_in_child", np.float64, (len(self), 6))


@dataclass(frozen=True, eq=False)
class ImuStream(Stream):
    """What an IMU feels, in its own frame.

    Args:
        stamps: (N,) int64 ns.
        angular_velocity: (N, 3) rad/s.
        linear_acceleration: (N, 3) m/s2, the specific force a - g: at rest it points up.
        frame_id: the IMU frame.
    """

    angular_velocity: Array
    linear_acceleration: Array
    frame_id: str

    def __post_init__(self) -> None:
        super().__post_init__()
        self._freeze("angular_velocity", np.float64, (len(self), 3))
        self._freeze("linear_acceleration", np.float64, (len(self), 3))
