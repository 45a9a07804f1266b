"""Changes of what is carried: another payload than declared, a mass that comes, goes or runs out."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from benchmarks.concealed.changes.base import Change, direction, named, place_in
from benchmarks.concealed.motions import DURATION
from benchmarks.concealed.payload import Payload
from benchmarks.concealed.robot import LOAD
from poise.types import Array

if TYPE_CHECKING:
    from benchmarks.concealed.engine import Engine
    from benchmarks.concealed.scene import Scene

SPECK = 1e-9  # kg and kg m2, a body that is not there


@dataclass
class OtherPayload(Change):
    """The payload is not the declared one: `mass` relative, `com` (3,) m, `inertia` relative."""

    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: float = 0.0

    def carry(self, payload: Payload) -> Payload:
        changed = Payload(payload.mass * (1 + self.mass), payload.com + self.com, payload.inertia * (1 + self.inertia))
        gained = (changed.inertia - payload.inertia)[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        self.parameters = {"mass": changed.mass - payload.mass, **named("com", self.com)}
        tags = ("xx", "xy", "xz", "yy", "yz", "zz")
        self.parameters |= {f"inertia_{tag}": float(value) for tag, value in zip(tags, gained, strict=True)}
        return changed


@dataclass
class PointMass(Change):
    """A point fixed to the load with `masses` at `times`; the payload counts it as it is in the beginning."""

    place: Array = field(default_factory=lambda: np.zeros(3))
    times: tuple[float, ...] = ()
    masses: tuple[float, ...] = ()
    sudden: bool = True

    def carry(self, payload: Payload) -> Payload:
        return payload.without_point(self.masses[0], self.place) if self.masses[0] > 0 else payload

    def shape(self, spec: mujoco.MjSpec) -> None:
        body = spec.body(LOAD).add_body(name="point_mass", pos=self.place)
        body.mass, body.ipos = max(self.masses[0], SPECK), np.zeros(3)
        body.inertia, body.explicitinertial = [SPECK] * 3, True

    def begin(self, engine: "Engine") -> None:
        self._body = engine.model.body("point_mass").id
        self._now = self.masses[0]

    def push(self, engine: "Engine", seconds: float) -> None:
        if self.sudden:
            mass = self.masses[int(np.searchsorted(self.times, seconds, side="right"))]
        else:
            mass = float(np.interp(seconds, self.times, self.masses))
        if mass != self._now:
            engine.set_mass(self._body, max(mass, SPECK))
            self._now = mass


def payload_parameters(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """Mass, centre of mass, inertia or all of them are not as declared."""
    share = np.ones(3) if rng.random() < 0.4 else np.eye(3)[rng.choice(3, p=[0.4, 0.4, 0.2])]
    sign = rng.choice([-1, 1], 3)
    return OtherPayload(
        name="payload_parameters",
        settles=("payload",),
        mass=0.06 * strength * share[0] * sign[0],
        com=0.012 * strength * share[1] * direction(rng),
        # A body's inertia grows without bound but shrinks to nothing: one sign.
        inertia=0.6 * strength * share[2] * (1.0 if sign[2] > 0 else -0.7),
    )


def mass_step(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """Something is welded on, or let go, on the way."""
    mass, time = 0.3 * strength, rng.uniform(6.0, DURATION - 6.0)
    place = place_in(rng, scene.payload)
    gained = mass if rng.random() < 0.5 else -mass
    masses = (0.0, mass) if gained > 0 else (mass, 0.0)
    return PointMass(
        name="mass_step",
        parameters={"mass": gained, "time": time, **named("", place)},
        windows=[(time, DURATION)],
        place=place,
        times=(time,),
        masses=masses,
    )


def mass_leak(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """A vessel runs out."""
    rate, start = 0.008 * strength, rng.uniform(1.0, 14.0)
    place = place_in(rng, scene.payload)
    mass = rate * (DURATION - start)
    return PointMass(
        name="mass_leak",
        parameters={"rate": rate, "start": start, **named("", place)},
        windows=[(start, DURATION)],
        place=place,
        times=(start, DURATION),
        masses=(mass, 0.0),
        sudden=False,
    )
