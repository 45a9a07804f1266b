"""What an effect of this world is: how it is drawn and scaled, and what it does to motion, sensor and clock."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from benchmarks.foreign.robots import Array
from benchmarks.foreign.world import Mechanism, Scene, Track, World

AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Fault(Mechanism):
    """An effect; `size` is what the strength scales.

    Args:
        size: in the unit that the class gives.
        truth: parameters that are drawn once, by name.
    """

    size: float = 1.0
    truth: dict[str, Any] = field(default_factory=dict)

    name: ClassVar[str] = ""
    """The name in the tool's library; a name of this world where the library has none."""
    accept: ClassVar[tuple[str, ...]] = ()
    """Other names that are right too."""
    needs: ClassVar[str] = "any"
    """`wrench`, `effort` or `any`: what the recording must have."""
    usual: ClassVar[float] = 1.0
    largest: ClassVar[float] = np.inf
    """The size at which the search begins, and the largest one that is used."""
    outside_tolerance: ClassVar[float] = 0.0
    """The size that a tolerance of model.yaml still allows; strength 1 is at least five of it."""
    simulated: ClassVar[bool] = True
    """The world must be simulated again when the size changes."""
    steady: ClassVar[bool] = False
    """A constant part of the change counts; otherwise a bias may take its place."""
    rotary: ClassVar[bool] = False
    """Shows only where a rotary joint moves."""
    stage: ClassVar[int] = 0
    """Order in the sensor's chain."""
    library: ClassVar[bool] = True
    """The tool has a name for it."""

    @classmethod
    def draw(cls, scene: Scene, track: Track, rng: np.random.Generator) -> Self:
        """Random parameters for a scene whose healthy run is known."""
        return cls(cls.usual, cls.random(scene, track, rng))

    @classmethod
    def random(cls, scene: Scene, track: Track, rng: np.random.Generator) -> dict[str, Any]:
        """Parameters beside the size."""
        return {}

    def at(self, size: float) -> Self:
        """The same effect with another size."""
        return replace(self, size=float(size))

    def limit(self, scene: Scene) -> float:
        """The largest size in a scene."""
        return self.largest

    def sense(self, track: Track, wrench: Array) -> Array:
        """(N, 6) what the sensor's chain makes of the wrench, before noise."""
        return wrench

    def read(self, wrench: Array) -> Array:
        """(n, 6) the last step of the chain, after noise."""
        return wrench

    def encode(self, position: Array) -> Array:
        """(N, J) what encoders report."""
        return position

    def clock(self, seconds: Array) -> Array:
        """(N,) s, stamps of wrenches that are taken at these times."""
        return seconds

    def parameters(self) -> dict[str, float]:
        """For the label: name and value."""
        return {}


class LoadFault(Fault):
    """An effect on or in the load; it shows in the wrench, or in efforts where there is no sensor."""

    def spot(self) -> Array:
        """(3,) m in sensor axes, the point that it acts on."""
        return np.asarray(self.truth["place"])


def point_on(scene: Scene, rng: np.random.Generator) -> list[float]:
    """A random point of the load, in sensor axes."""
    whole = scene.load.whole
    return list(whole.com + rng.uniform(-0.08, 0.08, 3))


def direction(rng: np.random.Generator, count: int = 3) -> Array:
    """A random unit vector."""
    vector = rng.normal(size=count)
    return np.asarray(vector / np.linalg.norm(vector))


def vector(stem: str, value: Array, scale: float = 1.0) -> dict[str, float]:
    """`stem_x`, `stem_y`, `stem_z` of a vector."""
    return {f"{stem}_{axis}": float(scale * v) for axis, v in zip(AXES, value, strict=True)}


def window(track: Track, shortest: float, longest: float, rng: np.random.Generator) -> tuple[float, float]:
    """A random window inside a run, in s, at most a third of it, not in its first 1.5 s."""
    end = float(track.seconds[-1])
    length = min(float(rng.uniform(shortest, longest)), end / 3)
    start = float(rng.uniform(1.5, end - length - 0.5))
    return start, start + length


def joint_scale(scene: Scene) -> Array:
    """(J,) how strong each joint's drive is, 1 for the strongest."""
    levels = np.array(scene.robot.effort)
    return np.asarray(levels / levels.max())


def moving_joint(scene: Scene, track: Track, rng: np.random.Generator) -> int:
    """A random joint among those that move and that matter."""
    travel = np.ptp(track.position, axis=0) / np.array(scene.robot.reach)
    return int(rng.choice(np.flatnonzero(travel >= min(0.3, travel.max() * 0.9))))


def dof_setter(world: World, joints: tuple[int, ...], rule: Callable[[Array, Array], Array]) -> None:
    """Set the dry friction of joints from their speeds and their rigid-body efforts."""
    dofs = world.dofs[list(joints)]
    world.model.dof_frictionloss[dofs] = np.maximum(rule(world.data.qvel[dofs], world.data.qfrc_bias[dofs]), 1e-9)
