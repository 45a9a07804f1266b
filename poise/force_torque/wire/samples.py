"""What a device delivers: calibrated samples, and the calibration that makes them out of counts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.force_torque.wire.units import newton_metres_per, newtons_per
from poise.types import Array, Mask


class Reports(Enum):
    """Whose force a device reports; Poise's contract is LOAD_ON_SENSOR."""

    LOAD_ON_SENSOR = "load_on_sensor"
    SENSOR_ON_LOAD = "sensor_on_load"

    @property
    def sign(self) -> int:
        """Factor to the contract's sign."""
        return 1 if self is Reports.LOAD_ON_SENSOR else -1


def _unlimited() -> Array:
    return np.full(6, np.inf)


@dataclass(frozen=True)
class Calibration:
    """From counts to N and N m, in the contract's sign.

    Attributes:
        force_per_count: N, with the sign of the contract.
        torque_per_count: N m, with the sign of the contract.
        limit: (6,) rated load per axis, N and N m; a sample at or beyond it is saturated. inf: unknown.
    """

    force_per_count: float
    torque_per_count: float
    limit: Array = field(default_factory=_unlimited)

    @classmethod
    def from_counts(
        cls,
        counts_per_force: float,
        counts_per_torque: float,
        force_unit: str = "N",
        torque_unit: str = "N m",
        limit: Sequence[float] | None = None,
        reports: Reports = Reports.LOAD_ON_SENSOR,
    ) -> "Calibration":
        """Build from what data sheets and the devices' pages give.

        Args:
            counts_per_force: counts per force unit, > 0.
            counts_per_torque: counts per torque unit, > 0.
            force_unit, torque_unit: names that poise.force_torque.units knows.
            limit: six rated loads in those units (a zero: no limit for that axis), or None.
            reports: whose force the device reports.

        Raises:
            InputError: BAD_INPUT, for counts that are not positive and finite or not six limits;
                UNSUPPORTED, for an unknown unit.
        """
        for name, counts in (("force", counts_per_force), ("torque", counts_per_torque)):
            if not (math.isfinite(counts) and counts > 0):
                raise InputError(ErrorCode.BAD_INPUT, f"counts per {name} must be positive and finite, not {counts}")
        newtons, newton_metres = newtons_per(force_unit), newton_metres_per(torque_unit)
        si_limit = _unlimited()
        if limit is not None:
            rated = np.asarray(limit, dtype=float)
            if rated.shape != (6,) or not np.all(np.isfinite(rated)) or np.any(rated < 0):
                raise InputError(ErrorCode.BAD_INPUT, f"limits must be six numbers >= 0 (0: none), not {limit}")
            si = rated * np.repeat([newtons, newton_metres], 3)
            si_limit = np.where(si > 0, si, np.inf)
        sign = reports.sign
        return cls(sign * newtons / counts_per_force, sign * newton_metres / counts_per_torque, si_limit)

    def with_limit(self, limit: Array) -> "Calibration":
        """This calibration with other rated loads, (6,) N and N m, where those are finite."""
        return replace(self, limit=np.where(np.isfinite(limit), limit, self.limit))

    @cached_property
    def _scale(self) -> Array:
        return np.repeat([self.force_per_count, self.torque_per_count], 3)

    def wrench(self, counts: ArrayLike) -> Array:
        """Convert (N, 6) counts to (N, 6) N and N m, what the load exerts on the sensor."""
        wrench: Array = np.multiply(counts, self._scale, dtype=np.float64)
        return wrench

    def samples(self, sequence: NDArray[np.uint32], counts: ArrayLike, arrival: int, rejected: int) -> "SensorSamples":
        """Samples of a device without a status word; those at or beyond the rated load are saturated."""
        wrench = self.wrench(counts)
        none = np.zeros(len(sequence), dtype=np.uint32)
        return SensorSamples(sequence, wrench, none, self.saturated(wrench), none.astype(bool), arrival, None, rejected)

    def saturated(self, wrench: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) which of (N, 6) wrenches reach the rated load of an axis."""
        return np.asarray(np.any(np.abs(wrench) >= self.limit, axis=1))


@dataclass(frozen=True)
class SensorSamples:
    """SensorSamples as one read brought them, in order of arrival.

    Attributes:
        sequence: (N,) uint32 device sequence number; wraps from 2**32 - 1 to 0.
        wrench_in_sensor: (N, 6) N and N m, what the load exerts on the sensor.
        status: (N,) uint32 device status word; 0 is healthy.
        saturated: (N,) bool, by status word or rated load.
        faulty: (N,) bool, the device itself calls the sample wrong.
        arrival: ns since the epoch at which the last sample arrived (never before it was measured).
        measured: uint32 counter of the device's own measurements at the last sample, None where it has none.
        rejected: messages of this read that were not valid.
    """

    sequence: NDArray[np.uint32]
    wrench_in_sensor: Array
    status: NDArray[np.uint32]
    saturated: Mask
    faulty: Mask
    arrival: int
    measured: int | None = None
    rejected: int = 0

    def __len__(self) -> int:
        return len(self.sequence)

    def take(self, index: NDArray[np.intp]) -> "SensorSamples":
        """The samples at these indices, in that order."""
        return SensorSamples(
            self.sequence[index],
            self.wrench_in_sensor[index],
            self.status[index],
            self.saturated[index],
            self.faulty[index],
            self.arrival,
            self.measured,
            self.rejected,
        )


def no_samples(arrival: int, rejected: int = 0) -> SensorSamples:
    """An empty read."""
    empty = np.empty(0, dtype=np.uint32)
    none = np.empty(0, dtype=np.bool_)
    return SensorSamples(empty, np.empty((0, 6)), empty, none, none, arrival, rejected=rejected)
