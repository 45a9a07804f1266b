"""Parts of the load that move by themselves, as bodies and joints of the engine; the payload counts them as rigid."""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from scipy.linalg import eigh

from benchmarks.concealed.changes.base import Change, direction, flat, named, place_in
from benchmarks.concealed.payload import Payload, steiner
from benchmarks.concealed.robot import LOAD, set_inertia
from poise.geometry import STANDARD_GRAVITY
from poise.types import Array

if TYPE_CHECKING:
    from benchmarks.concealed.engine import Engine
    from benchmarks.concealed.scene import Scene

SMALL = 1e-6  # kg m2 of a body that is a point
ATTEMPTS = 200
LEAST_TILT = 0.1  # sine of the tilt to either side at which a loose part falls to its other stop


@dataclass
class Part(Change):
    """A point mass taken out of the payload at `place` that moves on a joint of its own."""

    place: Array = field(default_factory=lambda: np.zeros(3))
    mass: float = 0.0

    def carry(self, payload: Payload) -> Payload:
        return payload.without_point(self.mass, self.place)

    def add(self, spec: mujoco.MjSpec, com: Array | None = None) -> mujoco.MjsBody:
        """The part's body, without a joint yet."""
        body = spec.body(LOAD).add_body(name=self.name, pos=self.place)
        body.mass, body.inertia, body.explicitinertial = self.mass, [SMALL] * 3, True
        body.ipos = np.zeros(3) if com is None else com
        return body


@dataclass
class Pendulum(Part):
    """Slosh in a round vessel: a spherical pendulum about `place`."""

    length: float = 0.0
    damping_ratio: float = 0.0

    def shape(self, spec: mujoco.MjSpec) -> None:
        body = self.add(spec, np.array([0.0, 0.0, self.length]))  # tools point down at the start, and so does it
        rate = np.sqrt(STANDARD_GRAVITY / self.length)
        damping = 2 * self.damping_ratio * rate * self.mass * self.length**2
        body.add_joint(name=self.name, type=mujoco.mjtJoint.mjJNT_BALL, damping=[damping, 0, 0])


@dataclass
class Chain(Part):
    """Rods in a row that hang from `place` on ball joints: a rope."""

    links: int = 4
    link: float = 0.0
    damping_ratio: float = 0.0

    def shape(self, spec: mujoco.MjSpec) -> None:
        mass, parent, place = self.mass / self.links, spec.body(LOAD), self.place
        damping = 2 * self.damping_ratio * np.sqrt(STANDARD_GRAVITY / self.link) * mass * self.link**2
        for i in range(self.links):
            body = parent.add_body(name=f"{self.name}{i}", pos=place)
            body.mass, body.explicitinertial = mass, True
            body.inertia = mass * self.link**2 / 12 * np.array([1.0, 1.0, 0.01])
            body.ipos = np.array([0.0, 0.0, self.link / 2])  # tools point down at the start
            body.add_joint(name=f"{self.name}{i}", type=mujoco.mjtJoint.mjJNT_BALL, damping=[damping, 0, 0])
            parent, place = body, np.array([0.0, 0.0, self.link])

    def first_mode(self) -> tuple[float, float]:
        """Length, m, and mass, kg, of the pendulum of its first mode."""
        below = np.arange(self.links, 0, -1) - 1.0
        lower = np.minimum.outer(below, below)
        inertia = self.link**2 * (lower + 0.5 - np.eye(self.links) / 6)
        pull = self.link * (below + 0.5)
        squares, shapes = eigh(STANDARD_GRAVITY * np.diag(pull), inertia)
        share = float(pull @ shapes[:, 0]) ** 2
        return float(STANDARD_GRAVITY / squares[0]), share * self.mass / self.links


@dataclass
class Slider(Part):
    """A mass that slides along an axis: between stops (`gap` > 0), or on a spring (`frequency` > 0)."""

    axis: Array = field(default_factory=lambda: np.zeros(3))
    gap: float = 0.0
    frequency: float = 0.0
    damping_ratio: float = 0.0
    friction: float = 0.0

    def shape(self, spec: mujoco.MjSpec) -> None:
        rate = 2 * np.pi * self.frequency
        joint = self.add(spec).add_joint(name=self.name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=self.axis)
        joint.stiffness = [self.mass * rate**2, 0, 0]
        joint.damping = [2 * self.damping_ratio * rate * self.mass, 0, 0]
        joint.frictionloss = self.friction
        if self.gap:
            joint.limited, joint.range = True, [-self.gap / 2, self.gap / 2]
            joint.solref_limit = [0.008, 1.0]  # s, ratio: the stops give a little and swallow the knock


@dataclass
class SoftGrasp(Change):
    """The payload turns about a point of the sensor's axis on springs."""

    height: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0

    def carry(self, payload: Payload) -> Payload:
        self._whole = payload
        return Payload(SMALL, np.zeros(3), SMALL * np.eye(3))

    def shape(self, spec: mujoco.MjSpec) -> None:
        place = np.array([0.0, 0.0, self.height])
        body = spec.body(LOAD).add_body(name=self.name, pos=place)
        set_inertia(body, Payload(self._whole.mass, self._whole.com - place, self._whole.inertia))
        joint = body.add_joint(name=self.name, type=mujoco.mjtJoint.mjJNT_BALL)
        joint.stiffness, joint.damping = [self.stiffness, 0, 0], [self.damping, 0, 0]


@dataclass
class Rotor(Change):
    """A rotor that spins freely about `axis`, whose angular momentum against the load is `momentum`."""

    axis: Array = field(default_factory=lambda: np.zeros(3))
    momentum: float = 0.0
    inertia: float = 2e-4
    place: Array = field(default_factory=lambda: np.zeros(3))
    mass: float = 0.05

    def carry(self, payload: Payload) -> Payload:
        rest = payload.without_point(self.mass, self.place)
        return Payload(rest.mass, rest.com, rest.inertia - self._moments(self.axis))

    def shape(self, spec: mujoco.MjSpec) -> None:
        body = spec.body(LOAD).add_body(name=self.name, pos=self.place)
        set_inertia(body, Payload(self.mass, np.zeros(3), self._moments(self.axis)))
        body.add_joint(name=self.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=self.axis)

    def begin(self, engine: "Engine") -> None:
        address = engine.model.joint(self.name).dofadr[0]
        engine.data.qvel[address] = self.momentum / self.inertia

    def _moments(self, axis: Array) -> Array:
        return np.asarray(self.inertia * (0.6 * np.eye(3) + 0.4 * np.outer(axis, axis)))


def slosh(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """Liquid in a round vessel."""
    mass, length = 0.7 * strength, rng.uniform(0.04, 0.1)
    ratio, place = rng.uniform(0.05, 0.15), room_for(mass, scene.payload, rng)
    return Pendulum(
        name="slosh",
        parameters={"mass": mass, "length": length, "damping_ratio": ratio, **named("", place)},
        place=place,
        mass=mass,
        length=length,
        damping_ratio=ratio,
    )


def hanging_chain(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A rope of four links."""
    mass, link, ratio = 0.25 * strength, rng.uniform(0.06, 0.15), rng.uniform(0.08, 0.2)
    place = room_for(mass, scene.payload, rng)
    made = Chain(name="hanging_chain", place=place, mass=mass, link=link, damping_ratio=ratio)
    length, first = made.first_mode()
    made.parameters = {"mass": first, "length": length, **named("", place)}
    return made


def loose_part(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A part with play; an axis across the tool, which the motion turns over."""
    mass, gap, axis = 0.25 * strength, rng.uniform(0.008, 0.014), turned_over(scene, rng)
    place = room_for(mass, scene.payload, rng)
    return Slider(
        name="loose_part",
        parameters={"mass": mass, "gap": gap, **named("axis", axis), **named("", place)},
        step=5e-4,
        place=place,
        mass=mass,
        axis=axis,
        gap=gap,
    )


def flexible_mode(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A part on a spring."""
    mass, frequency, ratio = 0.7 * strength, rng.uniform(3.0, 7.0), rng.uniform(0.02, 0.08)
    axis, place = direction(rng), room_for(mass, scene.payload, rng)
    return Slider(
        name="flexible_mode",
        parameters={
            "mass": mass,
            "frequency": frequency,
            "damping_ratio": ratio,
            **named("axis", axis),
            **named("", place),
        },
        step=5e-4,
        place=place,
        mass=mass,
        axis=axis,
        frequency=frequency,
        damping_ratio=ratio,
    )


def grasp_compliance(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A soft grasp."""
    whole, height = scene.payload, rng.uniform(0.0, 0.03)
    stiffness, ratio = 25.0 / strength, rng.uniform(0.1, 0.3)
    about_x = (whole.inertia + whole.mass * steiner(whole.com - [0.0, 0.0, height]))[0, 0]
    return SoftGrasp(
        name="grasp_compliance",
        parameters={"stiffness": stiffness, "damping_ratio": ratio, "height": height},
        step=5e-4,
        height=height,
        stiffness=stiffness,
        damping=2 * ratio * np.sqrt(stiffness * about_x),
    )


def flywheel(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A tool whose spindle runs."""
    momentum, axis = 0.06 * strength, direction(rng)
    return Rotor(
        name="flywheel",
        parameters=named("momentum", momentum * axis),
        axis=axis,
        momentum=momentum,
        place=scene.payload.com,
    )


def turned_over(scene: "Scene", rng: np.random.Generator) -> Array:
    """(3,) an axis across the tool that the motion tilts to both sides of the level: a part slides to and fro.

    Raises:
        ValueError: when there is none.
    """
    up = scene.preview.rotation_world_sensor[:, 2]
    for _ in range(ATTEMPTS):
        axis = flat(direction(rng), 0.4)
        tilt = up @ axis
        if min(tilt.max(), -tilt.min()) > LEAST_TILT:
            return axis
    raise ValueError("the motion turns no axis over")


def room_for(mass: float, payload: Payload, rng: np.random.Generator) -> Array:
    """(3,) a place from which the payload can spare this much mass.

    Raises:
        ValueError: when there is none.
    """
    leaner = replace(payload, inertia=0.88 * payload.inertia)  # as an honest error of the declared inertia may make it
    for _ in range(ATTEMPTS):
        place = place_in(rng, payload)
        try:
            leaner.without_point(1.02 * mass, place)
        except ValueError:
            continue
        return place
    raise ValueError(f"the payload has no room for a part of {mass:.2f} kg")
