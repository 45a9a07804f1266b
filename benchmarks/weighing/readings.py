"""Troubles of the reading: what becomes of correct wrenches between the sensor and the recording."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.foreign.fault import direction
from benchmarks.foreign.load import Body
from benchmarks.foreign.robots import Array
from benchmarks.foreign.world import GRAVITY


@dataclass(frozen=True, eq=False)
class Moments:
    """When and how wrenches were taken.

    Args:
        seconds: (n,) since the begin of the recording. turn: (n, 3, 3) the sensor's axes in the world.
        load: what the sensor carries. rng: chance.
    """

    seconds: Array
    turn: Array
    load: Body
    rng: np.random.Generator

    @property
    def down(self) -> Array:
        """(n, 3) m/s2, gravity in sensor axes."""
        return np.asarray(-GRAVITY * self.turn[:, 2, :])


Reading = Callable[[Moments, Array], Array]
"""From (n, 6) wrenches as they are to what is recorded."""


def scaled(*factors: float) -> Reading:
    """Each channel with its factor; one for force and one for torque if there are two."""
    row = np.repeat(factors, 3) if len(factors) == 2 else np.array(factors)
    return lambda when, wrench: wrench * row


def turned(degrees: float) -> Reading:
    """The sensor is mounted turned: about its own axis, or about any."""

    def read(when: Moments, wrench: Array) -> Array:
        axis = np.array([0.0, 0.0, 1.0]) if when.rng.random() < 0.5 else direction(when.rng)
        turn = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()
        return np.hstack([wrench[:, :3] @ turn, wrench[:, 3:] @ turn])

    return read


def in_base_axes(when: Moments, wrench: Array) -> Array:
    """In the axes of the base, about the origin of the sensor."""
    return np.hstack([np.einsum("nij,nj->ni", when.turn, part) for part in (wrench[:, :3], wrench[:, 3:])])


def swapped(when: Moments, wrench: Array) -> Array:
    """x and y are exchanged."""
    return wrench[:, [1, 0, 2, 4, 3, 5]]


def stuck(when: Moments, wrench: Array) -> Array:
    """One channel stays at its value from some moment on."""
    channel, first = int(when.rng.integers(6)), int(len(wrench) * when.rng.uniform(0, 0.3))
    held = wrench.copy()
    held[first:, channel] = held[first, channel]
    return held


def clipped(when: Moments, wrench: Array) -> Array:
    """Forces end at the limit of a range that is too small: 12 to 35 % of samples reach it in the loudest channel."""
    level = float(np.quantile(np.abs(wrench[:, :3]).max(axis=1), 1 - when.rng.uniform(0.12, 0.35)))
    return np.hstack([np.clip(wrench[:, :3], -level, level), wrench[:, 3:]])


def compensated(least: float, most: float) -> Reading:
    """The robot's controller subtracts the weight of a payload that was set: a share of the true one."""

    def read(when: Moments, wrench: Array) -> Array:
        weight = float(when.rng.uniform(least, most)) * when.load.mass * when.down
        return wrench - np.hstack([weight, np.cross(when.load.com, weight)])

    return read


def drifting(thermal: bool) -> Reading:
    """The offset moves by 1 to 3 N: in proportion to time, or as a sensor that warms up."""

    def read(when: Moments, wrench: Array) -> Array:
        along = np.concatenate([direction(when.rng), 0.05 * direction(when.rng)])
        course = when.seconds / when.seconds[-1]
        if thermal:
            course = 1 - np.exp(-when.seconds / when.rng.uniform(2, 6))
        return np.asarray(wrench + np.outer(course, float(when.rng.uniform(1, 3)) * along))

    return read


def tared(samples: int) -> Reading:
    """The sensor was zeroed with the load in the hand, by the mean of the first samples."""
    return lambda when, wrench: wrench - wrench[:samples].mean(axis=0)


def spiked(when: Moments, wrench: Array) -> Array:
    """Half a percent of the samples are electrical spikes."""
    hit = when.rng.random(wrench.shape) < 0.005
    size = np.repeat([40.0, 2.0], 3) * when.rng.uniform(0.5, 1.5, wrench.shape)
    return np.asarray(wrench + hit * size * when.rng.choice([-1, 1], wrench.shape))
