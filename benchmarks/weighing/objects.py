"""The five payloads: from a pen of 50 g to a gearbox of 8 kg."""

import numpy as np

from benchmarks.foreign.load import Body, Load

OBJECTS = {"pen": 0.05, "cup": 0.3, "drill": 1.0, "pot": 2.5, "gearbox": 8.0}
"""Usual mass, kg; each case draws its own within 15 %."""


def draw_object(name: str, share: float, rng: np.random.Generator) -> Load:
    """A box whose length follows its mass, beyond the sensor and off its axis, with a point mass in it.

    Args:
        name: of OBJECTS. share: of the mass that is the point mass, which may come, fall off or leak.
        rng: chance.
    """
    mass = OBJECTS[name] * float(rng.uniform(0.85, 1.15))
    size = rng.uniform([0.6, 0.6, 0.9], [1.2, 1.2, 1.8]) * 0.1 * mass ** (1 / 3)
    com = np.array([*rng.uniform(-0.25, 0.25, 2) * size[:2], float(rng.uniform(0.02, 0.06)) + size[2] / 2])
    moments = mass * (1 - share) / 12 * (size @ size - size**2)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    box = Body(mass * (1 - share), com, np.asarray(0.7 * np.diag(moments) + 0.3 * turn @ np.diag(moments) @ turn.T))
    return Load(box, mass * share, com + rng.uniform(-0.3, 0.3, 3) * size, com + np.array([0.0, 0.0, size[2] / 2]))
