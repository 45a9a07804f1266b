"""What the robot carries: mass, centre of mass, inertia; parts taken out of it and put back."""

from dataclasses import dataclass

import numpy as np

from poise.types import Array


@dataclass(frozen=True)
class Payload:
    """A rigid body in sensor axes, from the sensor's origin.

    Args:
        mass: kg.
        com: (3,) m.
        inertia: (3, 3) kg m2 about the centre of mass.
    """

    mass: float
    com: Array
    inertia: Array

    @classmethod
    def random(cls, rng: np.random.Generator) -> "Payload":
        """A box-like thing that a UR10 carries: 1.6 to 3 kg, up to 12 cm beyond the sensor."""
        mass = rng.uniform(1.6, 3.0)
        com = np.array([*rng.uniform(-0.025, 0.025, 2), rng.uniform(0.06, 0.12)])
        sides = rng.uniform(0.12, 0.24, 3)
        principal = mass / 12 * (np.sum(sides**2) - sides**2)
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        return cls(mass, com, turn @ np.diag(principal) @ turn.T)

    def without_point(self, mass: float, place: Array) -> "Payload":
        """The rest when a point mass (or a small body) at `place` is taken out.

        Raises:
            ValueError: when no body is the rest.
        """
        left = self.mass - mass
        if left <= 0:
            raise ValueError("the part weighs more than the whole")
        com = (self.mass * self.com - mass * place) / left
        about_origin = self.inertia + self.mass * steiner(self.com) - mass * steiner(place)
        inertia = about_origin - left * steiner(com)
        moments = np.linalg.eigvalsh(inertia)
        if moments[0] + moments[1] <= 1.02 * moments[2]:
            raise ValueError("the part reaches out of the whole")
        return Payload(left, com, inertia)


def steiner(point: Array) -> Array:
    """(3, 3) inertia about the origin of a unit point mass at (3,)."""
    return np.eye(3) * (point @ point) - np.outer(point, point)
