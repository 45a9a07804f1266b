"""What the sensor, its clock and the encoders make of the truth."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from benchmarks.concealed.changes.base import Change, direction, named
from benchmarks.concealed.motions import DURATION
from poise.types import Array

if TYPE_CHECKING:
    from benchmarks.concealed.engine import Log
    from benchmarks.concealed.scene import Scene

CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")


def _six() -> Array:
    return np.zeros(6)


@dataclass
class LowPass(Change):
    """time_constant y' = w - y, from rest."""

    time_constant: float = 0.0
    order: int = 10

    def sense(self, seconds: Array, wrench: Array, log: "Log") -> Array:
        return lagged(wrench, seconds[1] - seconds[0], self.time_constant)


@dataclass
class Turned(Change):
    """The measuring axes are turned by a rotation vector (3,)."""

    rotation: Array = field(default_factory=lambda: np.zeros(3))
    order: int = 20

    def sense(self, seconds: Array, wrench: Array, log: "Log") -> Array:
        turn = Rotation.from_rotvec(self.rotation).as_matrix()  # row vectors times R are R' times columns
        return np.hstack([wrench[:, :3] @ turn, wrench[:, 3:] @ turn])


@dataclass
class Gain(Change):
    """(1 + error) w."""

    error: Array = field(default_factory=lambda: np.zeros((6, 6)))
    order: int = 30

    def sense(self, seconds: Array, wrench: Array, log: "Log") -> Array:
        return wrench + wrench @ self.error.T


@dataclass
class Curved(Change):
    """w + quadratic w abs(w) + cubic w^3, channel by channel."""

    quadratic: Array = field(default_factory=_six)
    cubic: Array = field(default_factory=_six)
    order: int = 40

    def sense(self, seconds: Array, wrench: Array, log: "Log") -> Array:
        return wrench + self.quadratic * wrench * np.abs(wrench) + self.cubic * wrench**3


@dataclass
class Creep(Change):
    """w + fraction s with time_constant s' = w - s."""

    fraction: float = 0.0
    time_constant: float = 1.0
    order: int = 45

    def sense(self, seconds: Array, wrench: Array, log: "Log") -> Array:
        return wrench + self.fraction * lagged(wrench, seconds[1] - seconds[0], self.time_constant)


@dataclass
class Bias(Change):
    """w + bias + drift t / duration."""

    bias: Array = field(default_factory=_six)
    drift: Array = field(default_factory=_six)
    order: int = 50

    def sense(self, seconds: Array, wrench: Array, log: "Log") -> Array:
        return wrench + self.bias + np.outer(seconds / DURATION, self.drift)


@dataclass
class Clipped(Change):
    """Readings end at a limit (6,)."""

    limit: Array = field(default_factory=lambda: np.full(6, np.inf))
    order: int = 60

    def read(self, wrench: Array, rng: np.random.Generator) -> Array:
        return np.clip(wrench, -self.limit, self.limit)


@dataclass
class Coarse(Change):
    """Readings come in steps (6,)."""

    steps: Array = field(default_factory=lambda: np.ones(6))
    order: int = 70

    def read(self, wrench: Array, rng: np.random.Generator) -> Array:
        return np.round(wrench / self.steps) * self.steps


@dataclass
class Clock(Change):
    """The sensor's clock: late by `offset`, fast by `skew`."""

    offset: float = 0.0
    skew: float = 0.0

    def stamp(self, seconds: Array) -> Array:
        return np.asarray(seconds[0] + (seconds - seconds[0]) * (1 + self.skew) + self.offset)


@dataclass
class Encoders(Change):
    """Joints are reported with an offset (6,)."""

    offset: Array = field(default_factory=_six)

    def encode(self, position: Array) -> Array:
        return position + self.offset


def lagged(values: Array, step: float, time_constant: float) -> Array:
    """First-order lag of (K, 6), in balance at the start; exact for values that are straight between steps."""
    decay = np.exp(-step / time_constant)
    lag = time_constant / step * (1 - decay)
    # The exact response to a ramp between samples (first-order hold).
    numerator, denominator = [1 - lag, lag - decay], [1, -decay]
    start = values[:1]
    return np.asarray(lfilter(numerator, denominator, values - start, axis=0) + start)


def sensor_bias(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    bias = strength * _six_of(2.4, 0.15, rng)
    return Bias(name="sensor_bias", parameters=six("force", "torque", bias), settles=("bias",), bias=bias)


def bias_drift(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    drift = strength * _six_of(0.72, 0.048, rng)
    return Bias(name="bias_drift", parameters=six("force", "torque", drift), settles=("drift",), drift=drift)


def sensor_creep(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    fraction, constant = 0.08 * strength * rng.choice([-1, 1]), float(np.exp(rng.uniform(np.log(1.5), np.log(8.0))))
    return Creep(
        name="sensor_creep",
        parameters={"fraction": fraction, "time_constant": constant},
        fraction=fraction,
        time_constant=constant,
    )


def sensor_gain(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """One or two entries of the gain: of forces, of torques, or of torques that feel forces."""
    error = np.zeros((6, 6))
    block = str(rng.choice(["force", "torque", "cross"], p=[0.5, 0.25, 0.25]))
    rows, columns, size = {"force": (0, 0, 0.06), "torque": (3, 3, 0.06), "cross": (3, 0, 0.006)}[block]
    # A gain shows where its source varies: of three, the two that do most.
    varies = np.argsort(scene.preview.wrench[:, columns : columns + 3].std(axis=0))[1:]
    for row in rng.choice(3, rng.integers(1, 3), replace=False):
        error[rows + row, columns + rng.choice(varies)] = size * strength * rng.choice([-1, 1])
    parameters = {
        f"gain_{CHANNELS[i]}_{CHANNELS[j]}": float(error[i, j]) for i, j in zip(*np.nonzero(error), strict=True)
    }
    return Gain(name="sensor_gain", parameters=parameters, settles=("gain",), error=error)


def sensor_nonlinearity(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """One to three channels whose sensitivity changes with the load."""
    quadratic, cubic = _six(), _six()
    full_scale = np.repeat([20.0, 2.0], 3)
    loaded = np.abs(scene.preview.wrench).max(axis=0) / full_scale
    # Where there is little load there is little to bend.
    channels = rng.choice(6, rng.integers(1, 4), replace=False, p=loaded / loaded.sum())
    kinds = rng.choice(3)
    for channel in channels:
        quadratic[channel] = 0.06 * (kinds != 1) * rng.choice([-1, 1]) / full_scale[channel]
        cubic[channel] = 0.08 * (kinds != 0) * rng.choice([-1, 1]) / full_scale[channel] ** 2
    quadratic, cubic = quadratic * strength, cubic * strength
    parameters = {f"quadratic_{CHANNELS[i]}": float(quadratic[i]) for i in np.flatnonzero(quadratic)}
    parameters |= {f"cubic_{CHANNELS[i]}": float(cubic[i]) for i in np.flatnonzero(cubic)}
    return Curved(name="sensor_nonlinearity", parameters=parameters, quadratic=quadratic, cubic=cubic)


def sensor_rotation(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    rotation = 0.03 * strength * direction(rng)
    return Turned(
        name="sensor_rotation", parameters=named("rotation", rotation), settles=("rotation",), rotation=rotation
    )


def quantisation(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    steps = strength * np.repeat([1.0, 0.05], 3)
    parameters = {"force_step": float(steps[0]), "torque_step": float(steps[3])}
    return Coarse(name="quantisation", parameters=parameters, settles=("rounding",), steps=steps)


def saturation(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    force = rng.random() < 0.5
    here = slice(0, 3) if force else slice(3, 6)
    limit = np.full(6, np.inf)
    limit[here] = np.abs(scene.preview.wrench[:, here]).max() * (1 - 0.45 * strength)
    name = "force_limit" if force else "torque_limit"
    return Clipped(name="saturation", parameters={name: float(limit[here][0])}, limit=limit)


def low_pass(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    constant = 0.08 * strength
    return LowPass(name="low_pass", parameters={"time_constant": constant}, time_constant=constant)


def clock_offset(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    offset = 0.025 * strength * rng.choice([-1, 1])
    return Clock(name="clock_offset", parameters={"offset": offset}, settles=("clock",), offset=offset)


def clock_skew(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    skew = 0.0015 * strength * rng.choice([-1, 1])
    return Clock(name="clock_skew", parameters={"skew": skew}, skew=skew)


def joint_offset(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """One or two of the first five joints; of the last it would be a rotation of the sensor."""
    offset = _six()
    joints = rng.choice(5, rng.integers(1, 3), replace=False, p=[0.1, 0.25, 0.25, 0.2, 0.2])
    offset[joints] = 0.015 * strength * rng.choice([-1, 1], len(joints))
    parameters = {f"offset_{joint + 1}": float(offset[joint]) for joint in sorted(joints)}
    return Encoders(name="joint_offset", parameters=parameters, settles=("joints",), offset=offset)


def six(force: str, torque: str, values: Array) -> dict[str, float]:
    """`{force_x: .., torque_z: ..}`."""
    return named(force, values[:3]) | named(torque, values[3:])


def _six_of(force: float, torque: float, rng: np.random.Generator) -> Array:
    return np.concatenate([force * direction(rng), torque * direction(rng)])
