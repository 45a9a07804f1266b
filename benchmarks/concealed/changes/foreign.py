"""Physics outside the library: the right answer is `unknown`, alone or beside what a named effect explains of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter

from benchmarks.concealed.changes.base import Change, direction, flat, place_in
from benchmarks.concealed.changes.friction import SIZES, Torque
from benchmarks.concealed.changes.moving import Rotor, Slider, room_for
from benchmarks.concealed.changes.outside import Force
from benchmarks.concealed.motions import DURATION
from poise.types import Array

if TYPE_CHECKING:
    from benchmarks.concealed.engine import Engine, Log
    from benchmarks.concealed.scene import Scene


@dataclass
class Field(Force):
    """A force that follows from time, place and velocity by any law."""

    law: Callable[[float, Array, Array], Array] = field(default=lambda t, x, v: np.zeros(3))

    def force(self, seconds: float, point: Array, velocity: Array) -> Array:
        return self.law(seconds, point, velocity)


@dataclass
class Reading(Change):
    """What the sensor adds to the wrench (K, 6) by any law of it and of the motion."""

    law: Callable[[Array, Array, "Log"], Array] = field(default=lambda t, w, log: np.zeros_like(w))
    order: int = 48

    def sense(self, seconds: Array, wrench: Array, log: "Log") -> Array:
        return wrench + self.law(seconds, wrench, log)


@dataclass
class Grease(Change):
    """Viscous friction that goes with time."""

    damping: Array = field(default_factory=lambda: np.zeros(6))

    def effort(self, engine: "Engine", log: "Log") -> Array:
        return np.asarray(np.exp(-log.seconds / 9.0)[:, None] * self.damping * log.arm[1])


@dataclass
class SpinUp(Rotor):
    """A rotor that a motor in the load brings to speed between two times."""

    span: tuple[float, float] = (0.0, 1.0)

    def begin(self, engine: "Engine") -> None:
        self._address = engine.model.joint(self.name).dofadr[0]

    def push(self, engine: "Engine", seconds: float) -> None:
        start, end = self.span
        engine.data.qfrc_applied[self._address] = self.momentum / (end - start) if start <= seconds < end else 0.0


def magnetic_pull(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A magnet (or a charged wall) beside the path: the pull falls with the square of the distance."""
    place = place_in(rng, scene.payload)
    points = scene.point(place)
    magnet = points[rng.integers(500, 3000)] + 0.12 * direction(rng)
    reach = 0.15

    def law(t: float, x: Array, v: Array) -> Array:
        gap = magnet - x
        return np.asarray(size * gap / np.linalg.norm(gap) / (1 + gap @ gap / reach**2))

    size = 1.0
    largest = max(float(np.linalg.norm(law(0.0, point, point))) for point in points[::5])
    size = 6.0 * strength / largest
    return Field(name="magnetic_pull", place=place, law=law)


def wind_gusts(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """Gusts from one side, a random process of half a second, on the load's side and not on its centre of mass."""
    axis, place = np.array([*direction(rng, 2), 0.0]), place_in(rng, scene.payload, 0.06)
    grid = np.arange(0.0, DURATION + 0.1, 0.05)
    gusts = lfilter([0.12], [1, -0.88], lfilter([0.12], [1, -0.88], rng.normal(size=len(grid) + 200)))[200:]
    gusts *= 1.5 * strength / gusts.std()
    return Field(name="wind_gusts", place=place, law=lambda t, x, v: axis * np.interp(t, grid, gusts))


def rope_drag(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A rope that lies on the floor: dry friction against the motion, of one size at any speed."""
    size = 2.0 * strength

    def law(t: float, x: Array, v: Array) -> Array:
        level = v * [1.0, 1.0, 0.0]
        return -size * level / np.sqrt(level @ level + 0.02**2)

    return Field(name="rope_drag", place=place_in(rng, scene.payload), law=law)


def pump(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A pump on the load: a knock every now and then, each a wave that dies away."""
    axis, period, phase = direction(rng), rng.uniform(1.3, 2.4), rng.uniform(0, 1)

    def law(t: float, x: Array, v: Array) -> Array:
        since = (t + phase) % period
        wave = np.exp(-since / 0.12) * np.sin(2 * np.pi * 4.0 * since)
        return np.asarray(5.0 * strength * wave * axis)

    return Field(name="pump", place=place_in(rng, scene.payload), law=law)


def grasp_slip(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A part slips in its soft clamp when the load along it beats dry friction, and stays there until it turns over."""
    mass = 0.5 * strength
    return Slider(
        name="grasp_slip",
        step=5e-4,
        place=room_for(mass, scene.payload, rng),
        mass=mass,
        axis=flat(direction(rng), 0.3),
        frequency=2.5,
        damping_ratio=1.5,
        friction=mass * rng.uniform(3.0, 4.5),
    )


def spinning_up_rotor(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A spindle that is started on the way."""
    start = rng.uniform(3.0, 10.0)
    return SpinUp(
        name="spinning_up_rotor",
        axis=direction(rng),
        momentum=0.3 * strength,
        place=scene.payload.com,
        span=(start, start + rng.uniform(10.0, 18.0)),
    )


def thermal_gain(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """The sensor warms with the torque that it has borne lately, and its sensitivity with it."""
    constant = rng.uniform(8.0, 15.0)

    def law(t: Array, w: Array, log: "Log") -> Array:
        work = np.sum(w[:, 3:] ** 2, axis=1, keepdims=True)
        heat = np.cumsum(np.exp(t / constant)[:, None] * work, axis=0) * np.exp(-t / constant)[:, None]
        return np.asarray(0.12 * strength * heat / heat.max() * w)

    return Reading(name="thermal_gain", law=law)


def bouc_wen(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """Hysteresis of the sensor that does not depend on the rate (Bouc 1967, Wen 1976), n = 1."""
    share, width = 0.9 * strength, np.repeat([3.0, 0.25], 3)

    def law(t: Array, w: Array, log: "Log") -> Array:
        state, inner = np.zeros_like(w), np.zeros(6)
        for k, rise in enumerate(np.diff(w, axis=0) / width):
            inner = inner + rise - 0.5 * (np.abs(rise) * inner + rise * np.abs(inner))
            state[k + 1] = inner
        return share * np.repeat([1.0, 0.06], 3) * state

    return Reading(name="bouc_wen", law=law)


def hum_by_speed(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """The drives' current hums in the sensor's cable: near the mains' frequency, as loud as the joints are fast."""
    frequency, mix = rng.uniform(46.0, 49.0), rng.normal(size=6) * np.repeat([1.0, 0.05], 3)

    def law(t: Array, w: Array, log: "Log") -> Array:
        wave = np.linalg.norm(log.arm[1], axis=1) * np.sin(2 * np.pi * frequency * t)
        return np.asarray(0.8 * strength * wave[:, None] * mix / np.linalg.norm(mix[:3]))

    return Reading(name="hum_by_speed", law=law)


def cable_chain(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """The links of a cable chain catch: a force that comes and goes with one joint's angle."""
    joint, order, mix = int(rng.integers(3, 6)), rng.uniform(6, 12), rng.normal(size=6) * np.repeat([1.0, 0.05], 3)
    mix *= 0.8 * strength / np.linalg.norm(mix[:3])
    return Reading(name="cable_chain", law=lambda t, w, log: np.sin(order * log.arm[0][:, [joint]]) * mix)


def drive_interference(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """The wheel motors' currents, which go with the base's acceleration, leak into three channels of the sensor."""
    mix = rng.normal(size=(3, 6)) * np.repeat([1.5, 0.08], 3)
    mix[:, rng.choice(6, 3, replace=False)] = 0.0

    def law(t: Array, w: Array, log: "Log") -> Array:
        return np.asarray(strength * scene.motion.base(t)[2] @ mix)

    return Reading(name="drive_interference", law=law)


def housing_strain(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """The sensor's own cable bends its housing: an offset that goes with products of gravity's components."""
    mix = rng.normal(size=(3, 6)) * np.repeat([1.2, 0.08], 3)

    def law(t: Array, w: Array, log: "Log") -> Array:
        down = -log.rotation_world_sensor[:, 2]
        return np.asarray(strength * (down * down[:, [1, 2, 0]]) @ mix)

    return Reading(name="housing_strain", law=law)


def warming_grease(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """Viscous friction of cold grease, which goes as the gears warm up."""
    damping = 6.0 * strength * SIZES * rng.uniform(0.7, 1.2, 6)

    return Grease(name="warming_grease", damping=damping)


def hose_spring(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A hose package along the arm that stiffens as two joints turn it, in the efforts of both."""
    size, middle = 8.0 * strength * SIZES, rng.uniform(-0.3, 0.3, 6)
    joint = int(rng.choice([0, 3, 4]))

    def law(q: Array, v: Array, a: Array, rigid: Array) -> Array:
        torque = np.zeros_like(q)
        turned = q[:, joint] - q[:, joint].mean() - middle[joint]
        torque[:, joint] = size[joint] * turned * np.abs(turned)
        return torque

    return Torque(name="hose_spring", law=law)
