"""Buffers of the sensor's motion, filled sample by sample, and the motion at the stamp of a wrench."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.recording import interpolate, interpolate_rotations
from poise.robot.differentiation import GAP_INTERVALS
from poise.robot.motion import SensorMotion
from poise.robot.sources import MotionSource
from poise.types import Array, Mask, Stamps

PairingReasons = NDArray[np.str_]
BEGINNING = -(2**62)
"""ns, before all stamps."""
USED, MOVING, NO_KINEMATICS, STALE = "", "moving", "no_kinematics", "stale"


@dataclass(frozen=True)
class PairingSettings:
    """How wrenches are brought together with the motion.

    Args:
        max_gap: s between kinematic samples across which nothing is interpolated.
        rest_gap: s, max_gap for an attitude at rest; equal poses allow a longer gap.
        rest_window: s before and after a sample in which the sensor has to hold still to count as at rest.
        rest_turning: rad/s, and
        rest_speed: m/s below which it does.
        block: s of motion that are differentiated together,
        margin: s of neighbours on either side that take part in it.
        edge: s at the start and end of a stretch of kinematics where accelerations are too uncertain to be used.
        memory: s for which motion is remembered, for wrenches that come late.
    """

    max_gap: float = 0.2
    rest_gap: float = 1.0
    rest_window: float = 0.1
    rest_turning: float = 0.02
    rest_speed: float = 0.01
    block: float = 0.5
    margin: float = 0.5
    edge: float = 0.1
    memory: float = 3.0


class MotionBuffer(Protocol):
    """Motion that is known for good, from a source that grows.

    `decided` is the stamp (ns) up to which `pair` has its final answer; None before anything is known.
    """

    @property
    def decided(self) -> int | None:
        """See above."""

    def update(self, flush: bool = False) -> None:
        """Work out what the source has made possible; `flush`: do not wait for what comes after."""

    def pair(self, stamps: Stamps) -> tuple[SensorMotion, PairingReasons]:
        """Motion at stamps (N,), NaN where it is not known, and why one cannot be used (empty: it can)."""

    def forget_before(self, stamp: int) -> None:
        """Drop older motion."""

    def needs_from(self) -> int | None:
        """The oldest stamp that the source has to keep."""


class Samples:
    """Motion samples in a row: stamps (M,), rotation (M, 3, 3), and K more columns (M, K)."""

    def __init__(self, columns: int) -> None:
        self.stamps: Stamps = np.zeros(0, dtype=np.int64)
        self.rotation: Array = np.zeros((0, 3, 3))
        self.columns: Array = np.zeros((0, columns))
        self.forgotten: int | None = None

    def append(self, stamps: Stamps, rotation: Array, columns: Array) -> None:
        self.stamps = np.concatenate([self.stamps, stamps])
        self.rotation = np.concatenate([self.rotation, rotation])
        self.columns = np.concatenate([self.columns, columns])

    def forget_before(self, stamp: int) -> None:
        keep = int(np.searchsorted(self.stamps, stamp, "left"))
        if keep:
            self.forgotten = int(self.stamps[keep - 1])
            self.stamps, self.rotation = self.stamps[keep:].copy(), self.rotation[keep:].copy()
            self.columns = self.columns[keep:].copy()

    def reasons(self, stamps: Stamps, known: Mask) -> PairingReasons:
        """(N,) used where known; else why not."""
        reasons = np.where(known, USED, NO_KINEMATICS).astype("<U16")
        if self.forgotten is not None:
            reasons[~known & (stamps <= self.forgotten)] = STALE
        return reasons


def pair_moving(samples: Samples, stamps: Stamps, gap: float) -> tuple[SensorMotion, PairingReasons]:
    """Interpolate samples with omega, alpha, a in their columns; across at most `gap` s. See `MotionBuffer.pair`."""
    rotation = interpolate_rotations(samples.stamps, samples.rotation, stamps, max_gap=gap)
    rates = interpolate(samples.stamps, samples.columns, stamps, max_gap=gap)
    motion = SensorMotion(stamps, rotation.values, *np.hsplit(rates.values, 3))
    return motion, samples.reasons(stamps, rotation.found & rates.found)


class StaticPoseBuffer:
    """The sensor's attitude as sampled, and where it holds still.

    At rest means that the interpolated poses from `rest_window` before a stamp until as long after it turn and move
    more slowly than the limits. The rates are then zero by definition.
    """

    def __init__(self, source: MotionSource, settings: PairingSettings) -> None:
        self._source, self._settings = source, settings
        self._samples = Samples(3)  # translation, m
        self.decided: int | None = None

    def update(self, flush: bool = False) -> None:
        newest = self._source.newest
        if newest is None:
            return
        held = self._samples.stamps
        poses = self._source.poses(int(held[-1]) + 1 if len(held) else BEGINNING, newest)
        self._samples.append(poses.stamps, poses.rotation, poses.translation)
        self.decided = newest if flush else newest - _ns(self._settings.rest_window)

    def pair(self, stamps: Stamps) -> tuple[SensorMotion, PairingReasons]:
        samples, gap = self._samples, self._settings.rest_gap
        rotation = interpolate_rotations(samples.stamps, samples.rotation, stamps, max_gap=gap)
        turning, speed = self._path(stamps)
        motion = SensorMotion.at_rest(stamps, rotation.values)
        reasons = samples.reasons(stamps, rotation.found & np.isfinite(turning))
        too_fast = (turning > self._settings.rest_turning) | (speed > self._settings.rest_speed)
        reasons[(reasons == USED) & too_fast] = MOVING
        return motion, reasons

    def forget_before(self, stamp: int) -> None:
        self._samples.forget_before(stamp)

    def needs_from(self) -> int | None:
        held = self._samples.stamps
        return int(held[-1]) - _ns(self._settings.max_gap) if len(held) else None

    def _path(self, stamps: Stamps) -> tuple[Array, Array]:
        """Mean turning (rad/s) and speed (m/s) around stamps (N,); NaN where the poses do not reach far enough."""
        samples, window = self._samples, _ns(self._settings.rest_window)
        if not len(samples.stamps):
            return np.full(len(stamps), np.nan), np.full(len(stamps), np.nan)
        offsets = np.array([-window, -window // 2, 0, window // 2, window])
        times = np.clip(stamps[:, None] + offsets, samples.stamps[0], samples.stamps[-1])
        flat = np.column_stack([samples.rotation.reshape(-1, 9), samples.columns])
        path = interpolate(samples.stamps, flat, times.ravel(), max_gap=self._settings.rest_gap).values
        steps = np.diff(path.reshape(len(stamps), len(offsets), 12), axis=1)
        span = times[:, -1] - times[:, 0]
        seconds = np.where(span >= window, span * 1e-9, np.nan)  # at the ends, half of it has to do
        # |R - R'| is sqrt(2) times the angle between them, when that is small.
        turning = np.linalg.norm(steps[:, :, :9], axis=2).sum(axis=1) / np.sqrt(2) / seconds
        return turning, np.linalg.norm(steps[:, :, 9:], axis=2).sum(axis=1) / seconds


class SmoothedMotion:
    """The smoothed motion with its rates, worked out in blocks that begin and end at fixed stamps.

    A block is differentiated together with its neighbourhood. Because the blocks depend on stamps alone, a recording
    and the same messages live give the same motion.
    """

    def __init__(self, source: MotionSource, settings: PairingSettings) -> None:
        self._source, self._settings = source, settings
        self._samples = Samples(9)  # angular velocity, angular and linear acceleration
        self._next: int | None = None
        self.decided: int | None = None

    def update(self, flush: bool = False) -> None:
        newest = self._source.newest
        while newest is not None:
            begin = self._begin(newest)
            if begin is None:
                return
            end = begin + _ns(self._settings.block)
            if newest < end + _ns(self._settings.margin) and not flush:
                return
            self._work_out(begin, end)
            self._next = end

    def pair(self, stamps: Stamps) -> tuple[SensorMotion, PairingReasons]:
        return pair_moving(self._samples, stamps, self._settings.max_gap)

    def forget_before(self, stamp: int) -> None:
        self._samples.forget_before(stamp)

    def needs_from(self) -> int | None:
        return None if self._next is None else self._next - _ns(self._settings.margin) - _ns(self._settings.edge)

    def _begin(self, newest: int) -> int | None:
        """Where the next block begins: where the last one ended, or after a gap at the next sample."""
        remaining = self._source.stamps(BEGINNING if self._next is None else self._next, newest)
        if not len(remaining):
            return None
        first = int(remaining[0])
        return first if self._next is None or first - self._next > _ns(self._settings.max_gap) else self._next

    def _work_out(self, begin: int, end: int) -> None:
        margin, edge = _ns(self._settings.margin), _ns(self._settings.edge)
        stamps = self._source.stamps(begin - margin, end + margin)
        inside = stamps[(stamps >= begin) & (stamps < end)]
        if not len(inside):
            return
        self.decided = int(inside[-1])
        try:
            motion = self._source.motion(begin, end - 1, margin)
        except InputError as error:
            if error.code is not ErrorCode.TOO_FEW_SAMPLES:
                raise
            return
        steps = np.diff(stamps)
        # What counts as a gap for the differentiation has uncertain edges too.
        gap = (
            min(_ns(self._settings.max_gap), GAP_INTERVALS * float(np.median(steps[steps > 0])))
            if np.any(steps > 0)
            else 0
        )
        first, final = _stretch_ends(stamps, gap)
        sure = stamps[(stamps - first >= edge) & (final - stamps >= edge)]
        part = motion.select(_among(motion.stamps, sure))
        rates = (
            part.angular_velocity_in_sensor,
            part.angular_acceleration_in_sensor,
            part.linear_acceleration_in_sensor,
        )
        self._samples.append(part.stamps, part.rotation_world_sensor, np.hstack(rates))


def _among(stamps: Stamps, some: Stamps) -> Mask:
    """(N,) stamps that are among some that do not descend; `numpy.isin` sorts both."""
    if not len(some):
        return np.zeros(len(stamps), dtype=bool)
    return np.asarray(some[np.searchsorted(some, stamps).clip(max=len(some) - 1)] == stamps)


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


def _stretch_ends(stamps: Stamps, gap: float) -> tuple[Stamps, Stamps]:
    """First and last stamp (N,) of the stretch without gaps that each sample belongs to."""
    starts = np.concatenate([[True], np.diff(stamps) > gap])
    number = np.cumsum(starts) - 1
    ends = np.concatenate([starts[1:], [True]])
    return stamps[starts][number], stamps[ends][number]
