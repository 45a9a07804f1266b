"""Published errors of sensors: white noise, bias, drift, resolution, clocks."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.types import Array


@dataclass(frozen=True)
class WrenchNoise:
    """Errors of a force-torque sensor.

    Args:
        source: of the numbers.
        rate: Hz of its samples.
        force, torque: one-sigma white noise of a sample, N and N m.
        bias: constant offset, six numbers, N and N m.
        drift_force, drift_torque: random walk, N and N m after one second (grows with the root of time).
        resolution_force, resolution_torque: step of the numbers it reports, N and N m; 0: none.
        latency: s that its stamps are late: a sample stamped t was taken at t - latency.
        stamp_jitter: one-sigma error of a stamp, s, cut at 0.4 of a period.
    """

    source: str = "none"
    rate: float = 100.0
    force: float = 0.0
    torque: float = 0.0
    bias: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    drift_force: float = 0.0
    drift_torque: float = 0.0
    resolution_force: float = 0.0
    resolution_torque: float = 0.0
    latency: float = 0.0
    stamp_jitter: float = 0.0


@dataclass(frozen=True)
class JointNoise:
    """Errors of joint states.

    Args:
        rate: Hz.
        position: one-sigma white noise, rad or m.
        resolution: step of the encoder, rad or m; 0: none.
        velocity: one-sigma white noise, rad/s or m/s.
        effort: one-sigma white noise, N m or N.
        stamp_jitter: one-sigma error of a stamp, s, cut at 0.4 of a period.
    """

    rate: float = 125.0
    position: float = 0.0
    resolution: float = 0.0
    velocity: float = 0.0
    effort: float = 0.0
    stamp_jitter: float = 0.0


_THESIS = "thesis table 3.2, {} noise: standard deviations chosen by the specifications of the Robotiq FT-300"
_STREAM = "; steps of its serial stream (FT 300-S manual, section 4.4.2)"

WRENCH_NOISE = {
    "none": WrenchNoise(rate=100.0),
    "low": WrenchNoise(_THESIS.format("low"), 100.0, force=0.05, torque=0.0025),
    "moderate": WrenchNoise(_THESIS.format("moderate"), 100.0, force=0.1, torque=0.005),
    "high": WrenchNoise(_THESIS.format("high"), 100.0, force=0.33, torque=0.0067),
    "ft300": WrenchNoise(
        _THESIS.format("moderate") + _STREAM,
        100.0,
        force=0.1,
        torque=0.005,
        resolution_force=0.01,
        resolution_torque=0.001,
    ),
    "axia80": WrenchNoise(
        "ATI Axia80-M20, calibration SI-500-20: the stated resolution (0.1 N, 0.005 N m) taken as one sigma; "
        "10^6 counts per N and N m (manual 9610-05-Ethernet Axia, table 8.3)",
        1000.0,
        force=0.1,
        torque=0.005,
        resolution_force=1e-6,
        resolution_torque=1e-6,
    ),
    "gamma": WrenchNoise(
        "an ATI Gamma at rest, from one sample to the next, at its 698 Hz (Skrede, doi 10.5281/zenodo.11096791: the "
        "bag kuka_at_rest); the torque about z has a quarter of what is stated here",
        698.0,
        force=0.018,
        torque=0.0011,
    ),
}
"""Named sensors. Biases are zero, as they depend on the last zeroing; drifts are not published."""


def wrench_noise(name: str, **changes: object) -> WrenchNoise:
    """A named sensor, with some of its numbers changed.

    Raises:
        InputError: BAD_INPUT when there is no such sensor, naming those that are, or for a number out of its range.
    """
    if name not in WRENCH_NOISE:
        raise InputError(
            ErrorCode.BAD_INPUT, f"there is no sensor noise '{name}'; there are {', '.join(sorted(WRENCH_NOISE))}"
        )
    noise = replace(WRENCH_NOISE[name], **changes)  # type: ignore[arg-type]
    numbers = {key: value for key, value in vars(noise).items() if key not in ("source", "bias")}
    wrong = [key for key, value in numbers.items() if not (np.isfinite(value) and value >= 0.0)]
    if wrong or noise.rate <= 0.0 or len(noise.bias) != 6 or not np.isfinite(noise.bias).all():
        raise InputError(ErrorCode.BAD_INPUT, f"sensor noise {name}: {', '.join(wrong) or 'rate or bias'} out of range")
    return noise


class NoisyWrench:
    """A sensor that is read block by block; its readings do not depend on the size of the blocks.

    Args:
        noise: its errors.
        rng: source of randomness.
    """

    def __init__(self, noise: WrenchNoise, rng: np.random.Generator) -> None:
        self.noise = noise
        self._white, self._walk, self._clock = rng.spawn(3)
        self._drift = np.zeros(6)

    def report(self, wrench_in_sensor: Array) -> Array:
        """Readings of the next (N, 6) wrenches, sampled at its rate."""
        noise, shape = self.noise, wrench_in_sensor.shape
        sigma = np.repeat([noise.force, noise.torque], 3)
        step = np.repeat([noise.drift_force, noise.drift_torque], 3) / np.sqrt(noise.rate)
        drift = self._drift + np.cumsum(self._walk.normal(size=shape) * step, axis=0)
        self._drift = drift[-1] if len(drift) else self._drift
        said: Array = wrench_in_sensor + np.array(noise.bias) + drift + self._white.normal(size=shape) * sigma
        said[:, :3] = rounded(said[:, :3], noise.resolution_force)
        said[:, 3:] = rounded(said[:, 3:], noise.resolution_torque)
        return said

    def stamps(self, taken: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) ns: the stamps of samples at these times."""
        late = np.int64(round(self.noise.latency * 1e9))
        return taken + late + jitter(len(taken), self.noise.stamp_jitter, self.noise.rate, self._clock)


class NoisyJoints:
    """Encoders and motor currents, read block by block like `NoisyWrench`."""

    def __init__(self, noise: JointNoise, rng: np.random.Generator) -> None:
        self.noise = noise
        self._white, self._clock = rng.spawn(2)

    def report(self, position: Array, velocity: Array, effort: Array) -> tuple[Array, Array, Array]:
        """Joint states of the next (N, J) samples."""
        noise, white = self.noise, self._white.normal(size=(len(position), 3, position.shape[1]))
        said = rounded(position + white[:, 0] * noise.position, noise.resolution)
        return said, velocity + white[:, 1] * noise.velocity, effort + white[:, 2] * noise.effort

    def stamps(self, taken: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) ns: the stamps of samples at these times."""
        return taken + jitter(len(taken), self.noise.stamp_jitter, self.noise.rate, self._clock)


def rounded(values: Array, step: float) -> Array:
    """Values on the grid of a resolution; unchanged when that is zero."""
    return np.asarray(np.round(values / step) * step) if step > 0.0 else values


def jitter(count: int, sigma: float, rate: float, rng: np.random.Generator) -> NDArray[np.int64]:
    """(N,) ns of stamp error, so small that stamps stay in order."""
    error = np.clip(rng.normal(size=count) * sigma, -0.4 / rate, 0.4 / rate)
    return np.round(error * 1e9).astype(np.int64)
