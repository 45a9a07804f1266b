"""What acts on the load from outside: pulls, cables, air, a thing in the way."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from benchmarks.concealed.changes.base import Change, direction, named, place_in
from benchmarks.concealed.motions import DURATION
from benchmarks.concealed.robot import LOAD
from poise.types import Array

if TYPE_CHECKING:
    from benchmarks.concealed.engine import Engine, Log
    from benchmarks.concealed.scene import Scene

SQUEEZE = 0.005  # s, damping of the plate over its stiffness
SLOW = 0.005  # m/s of slip below which friction turns around


@dataclass
class Force(Change):
    """A force on a point of the load, from what the point does; `force` is what differs between kinds."""

    place: Array = field(default_factory=lambda: np.zeros(3))

    def push(self, engine: "Engine", seconds: float) -> None:
        point, velocity = engine.point(self.place), engine.velocity(self.place)
        engine.force_at(point, self.force(seconds, point, velocity))

    def force(self, seconds: float, point: Array, velocity: Array) -> Array:
        """(3,) N in the world, at a time, where the point is and how it moves."""
        raise NotImplementedError


@dataclass
class Pull(Force):
    """A constant force."""

    pull: Array = field(default_factory=lambda: np.zeros(3))

    def force(self, seconds: float, point: Array, velocity: Array) -> Array:
        return self.pull


@dataclass
class Drag(Force):
    """Drag of still air that grows with the square of the speed."""

    coefficient: float = 0.0

    def force(self, seconds: float, point: Array, velocity: Array) -> Array:
        return -self.coefficient * float(np.linalg.norm(velocity)) * velocity


@dataclass
class Cable(Change):
    """A tendon of the engine from a point of the load to an anchor; without tension below its rest length."""

    place: Array = field(default_factory=lambda: np.zeros(3))
    anchor: Array = field(default_factory=lambda: np.zeros(3))
    stiffness: float = 0.0
    damping: float = 0.0
    rest_length: float = 0.0

    def shape(self, spec: mujoco.MjSpec) -> None:
        spec.worldbody.add_site(name="anchor", pos=self.anchor)
        spec.body(LOAD).add_site(name="cable", pos=self.place)
        tendon = spec.add_tendon(name=self.name, springlength=[0.0, self.rest_length])
        tendon.stiffness, tendon.damping = [self.stiffness, 0, 0], [self.damping, 0, 0]
        tendon.wrap_site("anchor")
        tendon.wrap_site("cable")


@dataclass
class Plate(Force):
    """A soft plate stands in the way of the finger tip between two times: it gives way, damps and rubs.

    Args:
        place: (3,) m of the finger tip.
        surface: (3,) m, a point of the plate's surface in the world.
        normal: (3,) out of the surface, world.
        span: s between which the plate is there.
        stiffness, damping: N/m, N s/m along the normal.
        friction: coefficient.
    """

    surface: Array = field(default_factory=lambda: np.zeros(3))
    normal: Array = field(default_factory=lambda: np.zeros(3))
    span: tuple[float, float] = (0.0, 0.0)
    stiffness: float = 0.0
    damping: float = 0.0
    friction: float = 0.0

    def begin(self, engine: "Engine") -> None:
        self._touches: list[tuple[float, float]] = []

    def push(self, engine: "Engine", seconds: float) -> None:
        if self.span[0] <= seconds <= self.span[1]:
            super().push(engine, seconds)

    def force(self, seconds: float, point: Array, velocity: Array) -> Array:
        depth = float(self.normal @ (self.surface - point))
        closing = float(-self.normal @ velocity)
        press = max(self.stiffness * depth + self.damping * closing, 0.0) if depth > 0.0 else 0.0
        slip = velocity + closing * self.normal
        force = press * (self.normal - self.friction * slip / np.sqrt(slip @ slip + SLOW**2))
        if press > 0.0:
            self._touches.append((seconds, float(np.linalg.norm(force))))
        return np.asarray(force)

    def finish(self, engine: "Engine", log: "Log") -> None:
        times, sizes = zip(*self._touches, strict=True)
        self.windows = [(times[0], times[-1])]
        self.parameters["peak_force"] = max(sizes)


def world_force(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """Something pulls, mostly sideways."""
    pull = direction(rng) * [1.0, 1.0, 0.4]
    pull *= 2.0 * strength / np.linalg.norm(pull)
    place = place_in(rng, scene.payload, 0.05)
    return Pull(name="world_force", parameters={**named("force", pull), **named("", place)}, place=place, pull=pull)


def air_drag(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A large, light thing in still air."""
    place, coefficient = place_in(rng, scene.payload, 0.06), 1.5 * strength
    return Drag(
        name="air_drag",
        parameters={"coefficient": coefficient, **named("", place)},
        place=place,
        coefficient=coefficient,
    )


def cable(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A hose or a dress pack, half of them always taut and damped, half sometimes slack."""
    place = place_in(rng, scene.payload, 0.05)
    points = scene.point(place)
    anchor = points.mean(axis=0) + rng.uniform([-0.5, -0.5, 0.6], [0.5, 0.5, 1.0])
    length = np.linalg.norm(points - anchor, axis=1)
    taut = rng.random() < 0.5
    rest = 0.9 * length.min() if taut else float(np.quantile(length, 0.3))
    stiffness = 3.0 * strength / np.sqrt(np.mean(np.maximum(length - rest, 0.0) ** 2))
    damping = 2.0 * strength if taut else 0.0
    return Cable(
        name="cable",
        parameters={
            "stiffness": stiffness,
            "damping": damping,
            "rest_length": rest,
            **named("anchor", anchor),
            **named("", place),
        },
        place=place,
        anchor=anchor,
        stiffness=stiffness,
        damping=damping,
        rest_length=rest,
    )


def contact(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A plate where the finger tip turns back, so that it is touched once, for 0.6 to 3 s."""
    place = scene.payload.com + rng.uniform([-0.03, -0.03, 0.05], [0.03, 0.03, 0.1])
    seconds, points = scene.preview.seconds, scene.point(place)
    found: list[tuple[Array, int, float, float, float]] = []
    for _ in range(60):
        normal = direction(rng)
        height = points @ normal
        turns = np.flatnonzero((height[1:-1] < height[:-2]) & (height[1:-1] <= height[2:])) + 1
        for turn in turns[(seconds[turns] > 2.0) & (seconds[turns] < DURATION - 3.0)]:
            depth = rng.uniform(0.01, 0.06)
            first, last = _below(height, turn, height[turn] + depth)
            if 0.6 <= seconds[last] - seconds[first] <= 3.0:
                found.append((normal, turn, depth, seconds[first], seconds[last]))
    normal, turn, depth, start, end = found[rng.integers(len(found))]
    surface, friction, peak = points[turn] + normal * depth, rng.uniform(0.1, 0.5), 9.0 * strength
    there = (seconds >= start) & (seconds <= end)
    inside = ((surface - points) @ normal)[there]
    pressed = inside + SQUEEZE * np.gradient(inside, seconds[there])
    stiffness = peak / float(pressed.max()) / np.sqrt(1 + friction**2)
    return Plate(
        name="contact",
        parameters={"peak_force": peak, "friction": friction, **named("normal", normal)},
        windows=[(start, end)],
        place=place,
        surface=surface,
        normal=normal,
        span=(start - 0.02, end + 0.02),
        stiffness=stiffness,
        damping=SQUEEZE * stiffness,
        friction=friction,
    )


def _below(height: Array, turn: int, level: float) -> tuple[int, int]:
    """The stretch of samples around `turn` that lie below a level."""
    above = np.flatnonzero(height > level)
    before, after = above[above < turn], above[above > turn]
    return (int(before[-1]) + 1 if len(before) else 0, int(after[0]) - 1 if len(after) else len(height) - 1)
