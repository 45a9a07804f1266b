"""From what happened to what a rig records: sampling, noise, filters, rounding, clocks and losses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, sosfilt, sosfiltfilt

from benchmarks.foreign.bag import Joints, Odometry, Streams, Wrenches
from benchmarks.foreign.fault import Fault
from benchmarks.foreign.honest import Honest
from benchmarks.foreign.motions import STEP
from benchmarks.foreign.noise import NOISES, QUANTUM
from benchmarks.foreign.profiles import Profile
from benchmarks.foreign.robots import Array, Robot, urdf
from benchmarks.foreign.sensors import LEVER
from benchmarks.foreign.world import Scene, Track

ODOMETRY_RATE = 50.0
DRIVER_CUTOFF = 90.0
DRIVER_DELAY = np.sqrt(2) / (2 * np.pi * DRIVER_CUTOFF)
"""Hz and s, of the second-order Butterworth filter in the sensor's driver."""
Stream = TypeVar("Stream", Wrenches, Joints, Odometry)
_DRIVER = butter(2, DRIVER_CUTOFF, fs=1 / STEP, output="sos")
_OFFLINE = butter(2, 12.0, fs=1 / STEP, output="sos")


def in_order(faults: Sequence[Fault]) -> list[Fault]:
    """Effects in the order of the sensor's chain."""
    return sorted(faults, key=lambda fault: fault.stage)


def measured(track: Track, honest: Honest, faults: Sequence[Fault]) -> Array:
    """(N, 6) the wrench behind the sensor and its calibration, before noise and converter."""
    wrench, chain = track.wrench, in_order(faults)
    for fault in (f for f in chain if f.stage < 5):
        wrench = fault.sense(track, wrench)
    wrench = honest.sense(track.seconds, wrench)
    for fault in (f for f in chain if f.stage >= 5):
        wrench = fault.sense(track, wrench)
    return wrench


def sensed(track: Track, honest: Honest, faults: Sequence[Fault]) -> Array:
    """(N, 6) the wrench as it would be recorded without noise, on the clock of its stamps."""
    wrench = measured(track, honest, faults)
    for fault in in_order(faults):
        wrench = fault.read(wrench)
    stamps = stamped(track.seconds, honest, faults)
    return np.stack([np.interp(track.seconds, stamps, column) for column in wrench.T], axis=1)


def stamped(seconds: Array, honest: Honest, faults: Sequence[Fault]) -> Array:
    """(N,) s, what the wrench's clock says at these times."""
    stamps = seconds + honest.late
    for fault in faults:
        stamps = fault.clock(stamps)
    return stamps


def encoded(track: Track, honest: Honest, faults: Sequence[Fault]) -> Array:
    """(N, J) positions with the errors of the zeros, without noise."""
    position = track.position + honest.zeros
    for fault in faults:
        position = fault.encode(position)
    return position


@dataclass
class Recorder:
    """One rig recording one run.

    Args:
        profile: how. scene: what. honest: its errors. faults: what is wrong. rng: chance.
    """

    profile: Profile
    scene: Scene
    honest: Honest
    faults: Sequence[Fault]
    rng: np.random.Generator

    def record(self, track: Track) -> Streams:
        """Everything that the rig records of a run."""
        robot, profile = self.scene.robot, self.profile
        self.start = int(self.rng.integers(1_600_000_000, 1_760_000_000)) * 10**9 + int(self.rng.integers(10**9))
        commands = None
        if profile.commands:
            rows = self._rows(track, 100.0)
            q, v, _ = (values[rows] for values in self.scene.arm)
            commands = Joints(self._stamps(track.seconds[rows], 100.0), q, v, np.zeros((len(rows), 0)))
        return Streams(
            robot_description=urdf(robot),
            joints=self._joints(track, robot),
            names=robot.joints,
            frame=robot.frame,
            wrench=self._wrench(track) if profile.wrench else None,
            odom=self._odometry(track) if profile.mobile else None,
            commands=commands,
        )

    def _wrench(self, track: Track) -> Wrenches:
        profile = self.profile
        level = profile.force * np.repeat([1.0, LEVER], 3)
        wrench = self._noisy(measured(track, self.honest, self.faults), level, profile.noise)
        for fault in in_order(self.faults):
            wrench = fault.read(wrench)
        rows = self._rows(track, profile.wrench_rate)
        clock = stamped(track.seconds[rows], self.honest, self.faults)
        return self._kept(Wrenches(self._stamps(clock, profile.wrench_rate), wrench[rows]))

    def _noisy(self, values: Array, level: Array, family: str) -> Array:
        """With noise of `level` behind the filter of the driver, and rounded where the family is quantised."""
        noise = NOISES[family](len(values), values.shape[1], self.rng)
        if self.profile.filtering == "driver":
            values, noise = (sosfilt(_DRIVER, v - v[0], axis=0) + v[0] for v in (values, noise))
        elif self.profile.filtering == "offline":
            values, noise = (sosfiltfilt(_OFFLINE, v, axis=0) for v in (values, noise))
        noisy = values + level * noise / noise.std(axis=0)
        return np.asarray(np.round(noisy / (QUANTUM * level)) * QUANTUM * level if family == "quantised" else noisy)

    def _joints(self, track: Track, robot: Robot) -> Joints:
        profile = self.profile
        clean = encoded(track, self.honest, self.faults)
        position = clean + profile.encoder * np.array(robot.encoder) * self.rng.normal(size=clean.shape)
        if profile.bits:
            step = np.where(robot.prismatic > 0, 0.5, 2 * np.pi) / 2**profile.bits
            position = np.round(position / step) * step
        velocity = self._velocity(track, position)
        effort = np.zeros((len(position), 0))
        if profile.effort:
            level = profile.effort_level * np.array(robot.effort)
            effort = self._noisy(track.effort, level, profile.effort_noise)
        if profile.filtering == "offline":
            position = sosfiltfilt(_OFFLINE, position, axis=0)
            velocity = sosfiltfilt(_OFFLINE, velocity, axis=0)
        rows = self._rows(track, profile.joint_rate)
        seconds = track.seconds[rows] * (1 + profile.skew * 1e-6)
        stamps = self._stamps(seconds, profile.joint_rate)
        return self._kept(Joints(stamps, position[rows], velocity[rows], effort[rows]))

    def _velocity(self, track: Track, position: Array) -> Array:
        if self.profile.velocity == "absent":
            return np.zeros((len(position), 0))
        if self.profile.velocity == "filtered":
            keep = np.exp(-STEP / 0.015)
            rate = np.vstack([np.zeros((1, position.shape[1])), np.diff(position, axis=0) / STEP])
            return np.asarray(lfilter([1 - keep], [1, -keep], rate, axis=0))
        level = 30 * np.array(self.scene.robot.encoder)
        return np.asarray(track.velocity + level * self.rng.normal(size=track.velocity.shape))

    def _odometry(self, track: Track) -> Odometry:
        rows = self._rows(track, ODOMETRY_RATE)
        place, speed = self.profile.odometry
        pose = track.base[rows] + place * self.rng.normal(size=(len(rows), 3))
        v, yaw = track.base_velocity[rows], track.base[rows, 2]
        ahead = np.cos(yaw) * v[:, 0] + np.sin(yaw) * v[:, 1]
        aside = -np.sin(yaw) * v[:, 0] + np.cos(yaw) * v[:, 1]
        twist = np.column_stack([ahead, aside, v[:, 2]]) + speed * self.rng.normal(size=(len(rows), 3))
        stamps = self._stamps(track.seconds[rows], ODOMETRY_RATE)
        return self._kept(Odometry(stamps, pose, twist, self.profile.odometry))

    def _rows(self, track: Track, rate: float) -> NDArray[np.int64]:
        """Samples at a rate, with a random phase."""
        period = 1 / (rate * STEP)
        phase = float(self.rng.uniform(0, period))
        return np.round(np.arange(phase, len(track.seconds) - 1, period)).astype(np.int64)

    def _stamps(self, seconds: Array, rate: float) -> NDArray[np.int64]:
        """(n,) ns, in order, wrong as the profile's clock is."""
        late = np.zeros(len(seconds))
        if self.profile.clock == "jitter":
            late = np.clip(3e-4 * self.rng.normal(size=len(seconds)), -0.4 / rate, 0.4 / rate)
        elif self.profile.clock == "late":
            late = self.rng.exponential(1e-3, len(seconds)) - 1e-3
            late += (self.rng.random(len(seconds)) < 0.01) * self.rng.uniform(0, 0.015, len(seconds))
        stamps = self.start + np.round((seconds + late) * 1e9).astype(np.int64)
        return np.asarray(np.maximum.accumulate(stamps) + np.arange(len(stamps)))

    def _kept(self, stream: Stream) -> Stream:
        """Without the messages that are lost, one to six together."""
        kept = np.ones(len(stream.stamps), dtype=bool)
        while self.profile.lost and 1 - kept.mean() < self.profile.lost:
            first = int(self.rng.integers(1, len(kept)))
            kept[first : first + int(self.rng.integers(1, 7))] = False
        arrays: dict[str, Any] = {
            key: value[kept] for key, value in vars(stream).items() if isinstance(value, np.ndarray)
        }
        return replace(stream, **arrays)
