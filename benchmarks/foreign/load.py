"""The payload: a rigid body and a small part of it that an effect may set free."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.foreign.robots import Array


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body in sensor axes.

    Args:
        mass: kg. com: (3,) m from the sensor's origin. inertia: (3, 3) kg m2 about the centre of mass.
    """

    mass: float
    com: Array
    inertia: Array

    def joined(self, other: "Body") -> "Body":
        """Both as one body (parallel axes theorem)."""
        mass = self.mass + other.mass
        com = (self.mass * self.com + other.mass * other.com) / mass
        inertia = np.zeros((3, 3))
        for body in (self, other):
            d = body.com - com
            inertia += body.inertia + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
        return Body(mass, com, inertia)

    def document(self) -> dict[str, Any]:
        """The entry of model.yaml."""
        moments = self.inertia[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        return {"mass": float(self.mass), "com": self.com.tolist(), "inertia": moments.tolist()}


@dataclass(frozen=True, eq=False)
class Load:
    """What the sensor carries: the main body, and a point mass that belongs to it.

    Args:
        main: without the part.
        part: kg of the point mass. place: (3,) m, where it rests.
        tip: (3,) m, the point of the tool that touches things first.
    """

    main: Body
    part: float
    place: Array
    tip: Array

    @property
    def whole(self) -> Body:
        """All of it as one rigid body."""
        return self.without(0.0)

    def without(self, freed: float) -> Body:
        """The rigid body that is left when `freed` kg of the part are not fixed to it."""
        return self.main.joined(Body(self.part - freed, self.place, np.zeros((3, 3))))


def random_load(lightest: float, heaviest: float, rng: np.random.Generator) -> Load:
    """A box of random size beyond the frame, with a point mass of 15 to 35 % of the whole in it."""
    mass = float(rng.uniform(lightest, heaviest))
    size = rng.uniform([0.08, 0.08, 0.1], [0.2, 0.2, 0.3])
    com = np.array([*rng.uniform(-0.03, 0.03, 2), 0.03 + size[2] / 2])
    share = float(rng.uniform(0.15, 0.35))
    moments = mass * (1 - share) / 12 * (size @ size - size**2)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    main = Body(mass * (1 - share), com, np.asarray(0.6 * np.diag(moments) + 0.4 * turn @ np.diag(moments) @ turn.T))
    place = com + rng.uniform(-0.35, 0.35, 3) * size
    return Load(main, mass * share, place, com + np.array([0.0, 0.0, size[2] / 2]))


def changed(load: Load, mass: float, shift: Array, inertia: float) -> Load:
    """The load with another mass (factor), centre of mass (3,) m and inertia (factor), its part unchanged."""
    whole = load.whole
    moved = replace(
        load,
        main=Body(whole.mass * mass - load.part, load.main.com, load.main.inertia),
    )
    target = whole.com + shift
    com = (target * moved.main.mass + target * load.part - load.place * load.part) / moved.main.mass
    d = [(moved.main.mass, com - target), (load.part, load.place - target)]
    around = sum((m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in d), np.zeros((3, 3)))
    return replace(moved, main=Body(moved.main.mass, com, np.asarray(inertia * whole.inertia - around)))
