"""From what happened to what a bag holds: samples, noise, clocks, losses; and what the nominal model would expect."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.concealed.changes.base import Change
from benchmarks.concealed.engine import Engine, Log
from benchmarks.concealed.motions import DURATION, Motion
from benchmarks.concealed.payload import Payload
from benchmarks.concealed.robot import ARM_JOINTS, SENSOR, description
from poise.recording import ImuStream, JointStream, PoseStream, Stream, WrenchStream, write_recording
from poise.types import Array

FORCE, TORQUE = 0.1, 0.005
"""N and N m, one sigma of white noise: the thesis' moderate noise, after the specification of an FT-300."""

WHITE = np.repeat([FORCE, TORQUE], 3)
ENCODER, TACHOMETER = 1e-5, 5e-4  # rad, rad/s
TORQUE_SENSOR = np.array([0.3, 0.3, 0.3, 0.06, 0.06, 0.06])  # N m, of joint efforts
ODOMETER = np.array([1e-4, 1e-4, 1e-4])  # m, m, rad, while the base moves
GYRO, ACCELEROMETER = 0.002, 0.02  # rad/s, m/s2; their biases are as large again
JITTER = 3e-4  # s, one sigma of a stamp's error

PERIODS = {"wrench": 0.010, "joint_states": 0.008, "odom": 0.020, "imu": 0.010}  # s


@dataclass(frozen=True)
class Equipment:
    """What there is besides the wrench."""

    effort: bool
    imu: bool


@dataclass(frozen=True)
class Recorded:
    """What a bag holds.

    Args:
        streams: by topic.
        taken: (N,) s, the true sampling times of the wrench, lost samples included.
        clock: (N,) s, what the sensor's clock said then, without jitter.
    """

    streams: dict[str, Stream]
    taken: Array
    clock: Array

    def on_the_clock(self, time: float) -> float:
        """A time since the recording's start, in seconds since the first wrench stamp."""
        return float(np.interp(time, self.taken, self.clock) - self.clock[0])

    def write(self, path: Path) -> None:
        """The bag; nothing in it identifies the case."""
        write_recording(path, self.streams, robot_description=description())


def record(
    engine: Engine,
    log: Log,
    changes: Sequence[Change],
    equipment: Equipment,
    rng: np.random.Generator,
    quiet: bool = False,
) -> Recorded:
    """Sample a simulation as the robot's drivers would.

    Args:
        engine, log: what happened.
        changes: of sensor, clocks and encoders; honest errors among them.
        equipment: what the robot has.
        rng: where chance comes from.
        quiet: without noise and jitter, for tests.
    """
    start = int(rng.integers(1_600_000_000, 1_760_000_000)) * 10**9 + int(rng.integers(10**9))
    loudness = 0.0 if quiet else 1.0
    streams: dict[str, Stream] = {}
    times = {topic: _times(period, rng) for topic, period in PERIODS.items()}

    sensed = log.wrench
    for change in sorted(changes, key=lambda change: change.order):
        sensed = change.sense(log.seconds, sensed, log)
    taken = times["wrench"]
    wrench = _at(log, sensed, taken) + loudness * wrench_noise(_at(log, log.arm[1], taken), changes, rng)
    for change in sorted(changes, key=lambda change: change.order):
        wrench = change.read(wrench, rng)
    clock = taken
    for change in changes:
        clock = change.stamp(clock)
    streams["wrench"] = WrenchStream(_stamps(start, clock, changes, loudness, rng), wrench, SENSOR)
    streams["joint_states"] = _joint_states(engine, log, changes, equipment, times, (start, loudness), rng)
    streams["odom"] = _odom(engine.motion, times["odom"], _stamps(start, times["odom"], changes, loudness, rng), rng)
    if equipment.imu:
        stamps = _stamps(start, times["imu"], changes, loudness, rng)
        level = np.repeat([GYRO, ACCELEROMETER], 3)
        noise = level * (rng.normal(size=6) + rng.normal(size=(len(stamps), 6)))
        read = _at(log, log.imu, times["imu"]) + loudness * noise
        streams["imu"] = ImuStream(stamps, read[:, :3], read[:, 3:], "imu_link")
    return Recorded(_with_losses(streams, times, changes, rng), taken, clock)


def wrench_noise(velocity: Array, changes: Sequence[Change], rng: np.random.Generator) -> Array:
    """(N, 6) white noise, and coloured noise that grows with the joint speed (N, 6), at 100 Hz."""
    white = WHITE * np.prod([change.noise for change in changes])
    decay = np.exp(-PERIODS["wrench"] / rng.uniform(0.05, 0.3, 6))
    coloured = np.empty_like(velocity)
    for channel, keep in enumerate(decay):
        steps = rng.normal(size=len(velocity) + 300) * np.sqrt(1 - keep**2)
        coloured[:, channel] = lfilter([1], [1, -keep], steps)[300:]
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    return np.asarray(white * rng.normal(size=velocity.shape) + white * (0.2 + 0.5 * speed) * coloured)


def expected(declared: Payload, motion: Motion, changes: Sequence[Change], taken: Array) -> Array:
    """(N, 6) wrench that the declared payload would have at (N,) s if the motion were as encoders and odom say."""

    def arm(t: Array) -> tuple[Array, Array, Array]:
        position, velocity, acceleration = motion.arm(t)
        for change in changes:
            position = change.encode(position)
        return position, velocity, acceleration

    log = Engine(declared, Motion(motion.name, arm, motion.base), step=1e-3).run()
    clock = taken
    for change in changes:
        clock = change.stamp(clock)
    return np.stack([np.interp(clock, log.seconds, column) for column in log.wrench.T], axis=1)


def clean(log: Log, changes: Sequence[Change], taken: Array) -> Array:
    """(N, 6) what the sensor would read without noise at (N,) s."""
    sensed = log.wrench
    for change in sorted(changes, key=lambda change: change.order):
        sensed = change.sense(log.seconds, sensed, log)
    wrench = _at(log, sensed, taken)
    for change in sorted(changes, key=lambda change: change.order):
        wrench = change.read(wrench, np.random.default_rng(0))
    return wrench


def _joint_states(
    engine: Engine,
    log: Log,
    changes: Sequence[Change],
    equipment: Equipment,
    times: dict[str, Array],
    clock: tuple[int, float],
    rng: np.random.Generator,
) -> JointStream:
    taken, (start, loudness) = times["joint_states"], clock
    position, velocity = (_at(log, values, taken) for values in log.arm[:2])
    for change in changes:
        position = change.encode(position)
    position = position + loudness * ENCODER * rng.normal(size=position.shape)
    velocity = velocity + loudness * TACHOMETER * rng.normal(size=velocity.shape)
    effort = np.full_like(position, np.nan)
    if equipment.effort:
        given = log.effort + sum(part for change in changes if (part := change.effort(engine, log)) is not None)
        effort = _at(log, given, taken) + loudness * _effort_noise(_at(log, log.arm[1], taken), rng)
    stamps = _stamps(start, taken, changes, loudness, rng)
    return JointStream(stamps, ARM_JOINTS, position, velocity, effort)


def _effort_noise(velocity: Array, rng: np.random.Generator) -> Array:
    keep = np.exp(-PERIODS["joint_states"] / 0.1)
    coloured = lfilter([1], [1, -keep], rng.normal(size=velocity.shape) * np.sqrt(1 - keep**2), axis=0)
    white = rng.normal(size=velocity.shape)
    return np.asarray(TORQUE_SENSOR * (white + 0.3 * (0.3 + np.abs(velocity)) * coloured))


def _odom(motion: Motion, taken: Array, stamps: NDArray[np.int64], rng: np.random.Generator) -> PoseStream:
    pose, velocity, _ = motion.base(taken)
    moving = (np.abs(velocity).max(axis=1) > 1e-4)[:, None]
    pose = pose + moving * ODOMETER * rng.normal(size=pose.shape)
    rotation = np.zeros((len(pose), 3, 3))
    cosine, sine = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    rotation[:, 0, 0] = rotation[:, 1, 1] = cosine
    rotation[:, 1, 0], rotation[:, 0, 1], rotation[:, 2, 2] = sine, -sine, 1.0
    translation = np.column_stack([pose[:, :2], np.zeros(len(pose))])
    return PoseStream(stamps, rotation, translation, "odom", "base_link")


def _times(period: float, rng: np.random.Generator) -> Array:
    """(N,) s, even, with a phase of its own, in whole ms."""
    phase = int(rng.integers(round(period * 1e3))) * 1e-3
    return np.asarray(phase + period * np.arange(int((DURATION - phase) / period + 1e-9) + 1), dtype=np.float64)


def _at(log: Log, values: Array, taken: Array) -> Array:
    """Rows at times that are whole steps of the engine."""
    return np.asarray(values[np.round(taken / log.seconds[1]).astype(int)])


def _stamps(
    start: int, clock: Array, changes: Sequence[Change], loudness: float, rng: np.random.Generator
) -> NDArray[np.int64]:
    """(N,) ns, wrong by the jitter but in order."""
    period = clock[1] - clock[0]
    sigma = loudness * np.hypot(JITTER, sum(change.jitter for change in changes))
    error = np.clip(sigma * rng.normal(size=len(clock)), -0.45 * period, 0.45 * period)
    return np.asarray(start + np.round((clock + error) * 1e9).astype(np.int64))


def _with_losses(
    streams: dict[str, Stream], times: dict[str, Array], changes: Sequence[Change], rng: np.random.Generator
) -> dict[str, Stream]:
    kept = dict(streams)
    for topic in streams:
        for change in changes:
            gone = change.lost(topic, times[topic], rng)
            if gone is not None:
                kept[topic] = kept[topic].select(~gone)
    return kept
