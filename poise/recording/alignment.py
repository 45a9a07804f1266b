"""Aligning streams in time: the nearest sample, or what lies between two samples, never across a gap.

Everywhere: stamps are int64 ns and never go backwards; `clock_offset` seconds are added to a stream's stamps to bring
them to the clock of the wanted stamps; where there is no answer the value is NaN and the reason says why.
"""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from poise.errors import ErrorCode, InputError
from poise.geometry import quaternion_of_rotation, rotation_of_quaternion
from poise.recording.streams import Stream, flat_rows
from poise.types import Array, Mask, Stamps

Reasons = npt.NDArray[np.uint8]
StreamT = TypeVar("StreamT", bound=Stream)


class Reason(IntEnum):
    """Why a wanted stamp has a value, or why not."""

    FOUND = 0
    BEFORE = 1  # the stream starts later
    AFTER = 2  # the stream ends earlier
    GAP = 3  # the samples around are too far apart, or the nearest is too far away
    NOT_FINITE = 4  # a sample that is needed is NaN or infinite


@dataclass(frozen=True, eq=False)
class Pairing:
    """The sample nearest to each wanted stamp.

    Args:
        index: (M,) which sample; -1 where none is near enough.
        distance: (M,) s, from the wanted stamp to the nearest sample, negative when that comes before it.
        reason: (M,) of Reason.
    """

    index: npt.NDArray[np.int64]
    distance: Array
    reason: Reasons

    @property
    def found(self) -> Mask:
        """(M,) where there is a sample."""
        return np.asarray(self.reason == Reason.FOUND)


@dataclass(frozen=True, eq=False)
class Interpolated:
    """Values at the wanted stamps.

    Args:
        values: (M, ...) NaN where there is none.
        reason: (M,) of Reason.
    """

    values: Array
    reason: Reasons

    @property
    def found(self) -> Mask:
        """(M,) where there is a value."""
        return np.asarray(self.reason == Reason.FOUND)


def nearest(stamps: Stamps, wanted: Stamps, *, max_gap: float, clock_offset: float = 0.0) -> Pairing:
    """Pair each wanted stamp with the nearest sample, the earlier of two that are equally near.

    Args:
        stamps: (N,) of the stream.
        wanted: (M,) in any order.
        max_gap: s, how far away the sample may be.
        clock_offset: s, see above.

    Raises:
        InputError: TIME_BACKWARDS, TYPE_MISMATCH, BAD_INPUT for arguments that break these rules.
    """
    stamps, wanted, limit = _checked(stamps, wanted, max_gap, clock_offset)
    if not len(stamps):
        return Pairing(np.full(len(wanted), -1), np.full(len(wanted), np.nan), _outside(stamps, wanted))
    after = np.searchsorted(stamps, wanted).clip(0, len(stamps) - 1)
    before = (after - 1).clip(0)
    index = np.where(np.abs(stamps[before] - wanted) <= np.abs(stamps[after] - wanted), before, after)
    distance = stamps[index] - wanted
    near = np.abs(distance) <= limit
    reason = _outside(stamps, wanted)
    reason[reason == Reason.FOUND] = Reason.GAP
    reason[near] = Reason.FOUND
    return Pairing(np.where(near, index, -1), np.asarray(distance * 1e-9, dtype=np.float64), reason)


def interpolate(
    stamps: Stamps, values: Array, wanted: Stamps, *, max_gap: float, clock_offset: float = 0.0
) -> Interpolated:
    """Interpolate linearly; a stamp that hits a sample takes that sample (the last of several), without its neighbours.

    Args:
        stamps: (N,) of the stream.
        values: (N, ...) one row per stamp.
        wanted: (M,) in any order.
        max_gap: s, how far apart the two samples around a stamp may be.
        clock_offset: s, see above.

    Raises:
        InputError: as `nearest`; SHAPE_MISMATCH when stamps and values differ in number.
    """
    values = np.asarray(values, dtype=np.float64)
    before, weight, reason = _neighbours(stamps, len(values), wanted, max_gap, clock_offset)
    result = np.full((len(reason), *values.shape[1:]), np.nan)
    found = reason == Reason.FOUND
    share = weight[found].reshape(-1, *[1] * (values.ndim - 1))
    low, high = _ends(values, before[found], weight[found])
    result[found] = (1 - share) * low + share * high
    result[~np.isfinite(result)] = np.nan
    reason[found & ~_finite(result)] = Reason.NOT_FINITE
    return Interpolated(result, reason)


def interpolate_rotations(
    stamps: Stamps, rotations: Array, wanted: Stamps, *, max_gap: float, clock_offset: float = 0.0
) -> Interpolated:
    """Interpolate rotations at constant angular velocity along the shorter way (slerp; Shoemake 1985).

    Args:
        stamps: (N,) of the stream.
        rotations: (N, 3, 3) rotation matrices.
        wanted: (M,) in any order.
        max_gap: s, as in `interpolate`.
        clock_offset: s, see above.

    Returns:
        (M, 3, 3) rotation matrices.

    Raises:
        InputError: as `interpolate`.
    """
    rotations = np.asarray(rotations, dtype=np.float64).reshape(-1, 3, 3)
    before, weight, reason = _neighbours(stamps, len(rotations), wanted, max_gap, clock_offset)
    result = np.full((len(reason), 3, 3), np.nan)
    found = np.flatnonzero(reason == Reason.FOUND)
    low, high = _ends(rotations, before[found], weight[found])
    known = _finite(low) & _finite(high)
    reason[found[~known]] = Reason.NOT_FINITE
    if known.any():
        result[found[known]] = _slerp(low[known], high[known], weight[found[known], None])
    return Interpolated(result, reason)


def _slerp(low: Array, high: Array, share: Array) -> Array:
    """Turn from low towards high by a share (K, 1) of the way."""
    try:
        first, second = quaternion_of_rotation(low), quaternion_of_rotation(high)
    except ValueError as error:
        sentence = f"a matrix to interpolate is not a rotation ({error}): orthonormalise it first"
        raise InputError(ErrorCode.BAD_INPUT, sentence) from error
    second = np.where(np.sum(first * second, axis=1, keepdims=True) < 0, -second, second)
    apart, along = (np.linalg.norm(ends, axis=1, keepdims=True) for ends in (second - first, second + first))
    angle = 2 * np.arctan2(apart, along)
    size = np.sin(angle)
    before, after = (
        np.divide(np.sin(part * angle), size, out=part.copy(), where=size > 0) for part in (1 - share, share)
    )
    return rotation_of_quaternion(before * first + after * second)


def resample(stream: StreamT, wanted: Stamps, *, max_gap: float, clock_offset: float = 0.0) -> tuple[StreamT, Reasons]:
    """Interpolate every array of a stream: rotations by slerp, all else linearly.

    Args:
        stream: any stream.
        wanted: (M,) ns, rising.
        max_gap: s, as in `interpolate`.
        clock_offset: s, see above.

    Returns:
        A stream with the wanted stamps, and (M,) of Reason: NOT_FINITE where any of its arrays is not finite (columns
        that were never measured do not count).

    Raises:
        InputError: as `interpolate`.
    """
    options = {"max_gap": max_gap, "clock_offset": clock_offset}
    reason = interpolate(stream.stamps, np.zeros(len(stream)), wanted, **options).reason
    arrays: dict[str, Any] = stream.arrays()
    for name, values in arrays.items():
        if name == "stamps":
            continue
        method = interpolate_rotations if name.startswith("rotation") else interpolate
        result = method(stream.stamps, values, wanted, **options)
        arrays[name] = result.values
        measured = ~np.isnan(flat_rows(values)).all(axis=0)
        faulty = ~_finite(result.values.reshape(len(wanted), measured.size)[:, measured])
        reason[faulty & (reason == Reason.FOUND)] = Reason.NOT_FINITE
    return replace(stream, **{**arrays, "stamps": np.asarray(wanted)}), reason


def _checked(stamps: Stamps, wanted: Stamps, max_gap: float, clock_offset: float) -> tuple[Stamps, Stamps, float]:
    """Bring the stamps to the wanted clock and the gap to ns, once both make sense."""
    stamps, wanted = np.asarray(stamps), np.asarray(wanted)
    for name, array in (("stamps", stamps), ("wanted", wanted)):
        if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
            raise InputError(ErrorCode.TYPE_MISMATCH, f"{name} must be a row of integer nanoseconds: {array.dtype}")
    if (np.diff(stamps.astype(np.int64)) < 0).any():
        raise InputError(ErrorCode.TIME_BACKWARDS, "the stamps to align go backwards: sort the samples by stamp")
    if not (np.isfinite(max_gap) and max_gap >= 0 and np.isfinite(clock_offset)):
        sentence = f"max_gap {max_gap} and clock_offset {clock_offset} must be finite seconds, the gap not negative"
        raise InputError(ErrorCode.BAD_INPUT, sentence)
    return stamps.astype(np.int64) + round(clock_offset * 1e9), wanted.astype(np.int64), max_gap * 1e9


def _outside(stamps: Stamps, wanted: Stamps) -> Reasons:
    """Mark what lies before the first and after the last sample; without any sample, all lies before."""
    reason = np.zeros(len(wanted), dtype=np.uint8)
    if not len(stamps):
        reason[:] = Reason.BEFORE
    else:
        reason[wanted < stamps[0]] = Reason.BEFORE
        reason[wanted > stamps[-1]] = Reason.AFTER
    return reason


def _neighbours(
    stamps: Stamps, samples: int, wanted: Stamps, max_gap: float, clock_offset: float
) -> tuple[npt.NDArray[np.int64], Array, Reasons]:
    """Find the sample at or before each wanted stamp, the weight of the one after it, and whether they may be used."""
    stamps, wanted, limit = _checked(stamps, wanted, max_gap, clock_offset)
    if len(stamps) != samples:
        raise InputError(ErrorCode.SHAPE_MISMATCH, f"{len(stamps)} stamps for {samples} samples: give one for each")
    reason = _outside(stamps, wanted)
    if not len(stamps):
        return np.zeros(len(wanted), dtype=np.int64), np.zeros(len(wanted)), reason
    before = (np.searchsorted(stamps, wanted, "right") - 1).clip(0)
    after = (before + 1).clip(max=len(stamps) - 1)
    gap = stamps[after] - stamps[before]
    elapsed = wanted - stamps[before]
    reason[(reason == Reason.FOUND) & (elapsed > 0) & (gap > limit)] = Reason.GAP
    return before, elapsed / np.maximum(gap, 1), reason


def _ends(values: Array, before: npt.NDArray[np.int64], weight: Array) -> tuple[Array, Array]:
    """Return the samples before and after; a stamp that hits its sample does not ask for the one after."""
    after = np.where(weight > 0, before + 1, before)
    return values[before], values[after]


def _finite(values: Array) -> Mask:
    """(M,) whether all of a row is finite."""
    return np.asarray(np.isfinite(values).all(axis=tuple(range(1, values.ndim))))
