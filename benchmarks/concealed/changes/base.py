"""What may be wrong in a case: hooks into the engine, the sensor chain, the clocks and the encoders."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from benchmarks.concealed.payload import Payload
from poise.types import Array, Mask

if TYPE_CHECKING:
    from benchmarks.concealed.engine import Engine, Log


@dataclass
class Change:
    """One thing that differs from the nominal world; each hook does nothing until a change defines it.

    Args:
        name: as in the label: an effect of the library, or what is outside it.
        parameters: as README.md defines them; `finish` may add what only the simulation gives.
        windows: when it acts, s since the recording's start; empty: always.
        settles: groups of `honest` that this change sets itself, so that chance leaves them alone.
    """

    name: str = ""
    parameters: dict[str, float] = field(default_factory=dict)
    windows: list[tuple[float, float]] = field(default_factory=list)
    settles: tuple[str, ...] = ()
    step: float = 1e-3
    """s that the engine may integrate at a time."""
    order: int = 50
    """Where in the sensor's chain it acts, from the flange (0) to the reading (100)."""
    noise: float = 1.0
    """Times the sensor's white noise."""
    jitter: float = 0.0
    """s, one sigma of additional error of every stamp."""

    def carry(self, payload: Payload) -> Payload:
        """The rigid part of the payload, once the change has taken its share."""
        return payload

    def gravity(self, gravity_in_world: Array) -> Array:
        """(3,) m/s2 in the axes of odom."""
        return gravity_in_world

    def shape(self, spec: mujoco.MjSpec) -> None:
        """Add bodies, joints, tendons."""

    def begin(self, engine: "Engine") -> None:
        """Set speeds and remember addresses, when all has come to rest at the start."""

    def push(self, engine: "Engine", seconds: float) -> None:
        """Apply forces or change masses before each step of the engine."""

    def shift(self, seconds: Array) -> tuple[Array, Array, Array] | None:
        """Position, velocity, acceleration (N, 6) of the base's x, y, z, yaw, pitch, roll that odom does not report."""
        return None

    def sense(self, seconds: Array, wrench: Array, log: "Log") -> Array:
        """(K, 6) what the sensor makes of the wrench on it, at the engine's steps, before noise."""
        return wrench

    def read(self, wrench: Array, rng: np.random.Generator) -> Array:
        """(N, 6) what becomes of the samples after noise."""
        return wrench

    def stamp(self, seconds: Array) -> Array:
        """(N,) what the sensor's clock says at a time."""
        return seconds

    def encode(self, position: Array) -> Array:
        """(N, 6) what the encoders say of the joints."""
        return position

    def effort(self, engine: "Engine", log: "Log") -> Array | None:
        """(K, 6) what the motors give beyond what rigid links need."""
        return None

    def lost(self, topic: str, seconds: Array, rng: np.random.Generator) -> Mask | None:
        """(N,) bool, the messages of a topic that never arrive."""
        return None

    def finish(self, engine: "Engine", log: "Log") -> None:
        """Complete the label with what the simulation showed."""


def direction(rng: np.random.Generator, size: int = 3) -> Array:
    """A unit vector, any direction as likely."""
    vector = rng.normal(size=size)
    return np.asarray(vector / np.linalg.norm(vector))


def flat(vector: Array, share: float) -> Array:
    """A unit vector along `vector` with its z shrunk to a share."""
    shrunk = vector * np.array([1.0, 1.0, share])
    return np.asarray(shrunk / np.linalg.norm(shrunk))


def named(stem: str, values: Array, tags: str = "xyz") -> dict[str, float]:
    """`{stem_x: .., stem_y: .., stem_z: ..}`; without a stem `{x: ..}`."""
    return {f"{stem}_{tag}" if stem else tag: float(value) for tag, value in zip(tags, values, strict=True)}


def place_in(rng: np.random.Generator, payload: Payload, spread: float = 0.03) -> Array:
    """(3,) a point near the centre of mass."""
    return np.asarray(payload.com + rng.uniform(-spread, spread, 3))
