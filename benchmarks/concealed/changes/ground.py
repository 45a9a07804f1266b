"""What the floor does: it is not level, it shakes, or the base moves on it without odom's knowing."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.concealed.changes.base import Change, direction, named
from benchmarks.concealed.motions import DURATION
from poise.types import Array

if TYPE_CHECKING:
    from benchmarks.concealed.scene import Scene


@dataclass
class Slope(Change):
    """The floor is turned by a rotation vector (3,) against level."""

    rotation: Array = field(default_factory=lambda: np.zeros(3))

    def gravity(self, gravity_in_world: Array) -> Array:
        return np.asarray(Rotation.from_rotvec(-self.rotation).apply(gravity_in_world))


@dataclass
class Shaking(Change):
    """Sines in a window that fade in and out: acceleration (K, 6) amplitudes [m/s2], frequencies [Hz], phases."""

    window: tuple[float, float] = (0.0, DURATION)
    ramp: float = 0.5
    amplitudes: Array = field(default_factory=lambda: np.zeros((0, 6)))
    frequencies: Array = field(default_factory=lambda: np.zeros(0))
    phases: Array = field(default_factory=lambda: np.zeros(0))

    def shift(self, seconds: Array) -> tuple[Array, Array, Array]:
        e0, e1, e2 = (part[:, None] for part in faded(seconds, self.window, self.ramp))
        rates = 2 * np.pi * self.frequencies
        angle = np.outer(seconds, rates) + self.phases
        d0 = -np.sin(angle) / rates**2 @ self.amplitudes
        d1 = -np.cos(angle) / rates @ self.amplitudes
        d2 = np.sin(angle) @ self.amplitudes
        return e0 * d0, e1 * d0 + e0 * d1, e2 * d0 + 2 * e1 * d1 + e0 * d2


def faded(seconds: Array, window: tuple[float, float], ramp: float) -> tuple[Array, Array, Array]:
    """One inside a window and zero outside, with quintic steps of `ramp` s inside its ends; and two derivatives."""
    start, end = window
    u = np.clip(np.minimum(seconds - start, end - seconds) / ramp, 0.0, 1.0)
    sign = np.where(seconds < (start + end) / 2, 1.0, -1.0) / ramp
    return (
        u**3 * (10 - 15 * u + 6 * u**2),
        30 * u**2 * (1 - u) ** 2 * sign,
        60 * u * (1 - u) * (1 - 2 * u) / ramp**2,
    )


def base_tilt(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A floor that is not level."""
    rotation = np.array([*direction(rng, 2), 0.0]) * 0.03 * strength
    return Slope(name="base_tilt", parameters=named("rotation", rotation[:2], "xy"), rotation=rotation)


def base_motion(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """The base sways or slips on its wheels for a while; odom does not see it."""
    start, length = rng.uniform(2.0, 16.0), rng.uniform(6.0, 15.0)
    frequencies = np.array([rng.uniform(0.25, 0.45), rng.uniform(0.6, 0.9)])
    amplitudes = np.zeros((2, 6))
    amplitudes[0, :2], amplitudes[1, :2] = direction(rng, 2), 0.6 * direction(rng, 2)
    made = Shaking(
        window=(start, start + length),
        ramp=1.5,
        amplitudes=amplitudes,
        frequencies=frequencies,
        phases=rng.uniform(0, 2 * np.pi, 2),
    )
    peak = 0.5 * strength
    largest = np.linalg.norm(made.shift(np.arange(0, DURATION, 0.01))[2], axis=1).max()
    made.name, made.windows = "base_motion", [made.window]
    made.amplitudes = amplitudes * peak / largest
    made.parameters = {"peak_acceleration": peak}
    return made


def external_vibration(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A machine beside the robot shakes the floor, upright or level."""
    start, length = rng.uniform(0.0, 12.0), rng.uniform(8.0, 22.0)
    axis = np.array([0.0, 0.0, 1.0]) if rng.random() < 0.4 else np.array([*direction(rng, 2), 0.0])
    frequency, amplitude = rng.uniform(5.0, 30.0), 0.4 * strength
    return Shaking(
        name="external_vibration",
        parameters={"amplitude": amplitude, "frequency": frequency, **named("direction", axis)},
        windows=[(start, start + length)],
        window=(start, start + length),
        amplitudes=amplitude * np.concatenate([axis, np.zeros(3)])[None],
        frequencies=np.array([frequency]),
        phases=rng.uniform(0, 2 * np.pi, 1),
    )
