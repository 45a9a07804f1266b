"""What a lift weighs: the change of the force between two rests of the hand in one attitude."""

from typing import NamedTuple

import numpy as np

from poise.types import Array

_DRIFT = 0.05
"""N, one sigma: the zero of a sensor moves in the seconds of a lift, as its temperature and its hoses do."""


class LiftedMass(NamedTuple):
    """What was lifted.

    Args:
        mass, std: kg.
        aside, aside_std: N, of the change of force across gravity; 0 when the attitude is not known.
    """

    mass: float
    std: float
    aside: float
    aside_std: float


def lifted_mass(
    before: tuple[Array, Array], after: tuple[Array, Array], down: Array | None, gravity: float
) -> LiftedMass:
    """The mass by the change of the force: the hand and the zero of the sensor cancel.

    Args:
        before, after: (3,) mean of the force in the sensor frame, and standard deviation of one sample, N.
        down: (3,) m/s2 gravity in the sensor frame at both; None: not known.
        gravity: m/s2.
    """
    change = after[0] - before[0]
    # Samples of a filtered sensor are not independent: their spread counts in full.
    std = float(np.sqrt(np.max(before[1]) ** 2 + np.max(after[1]) ** 2 + _DRIFT**2))
    if down is None:
        return LiftedMass(float(np.linalg.norm(change)) / gravity, std / gravity, 0.0, 0.0)
    towards = down / np.linalg.norm(down)
    along = float(change @ towards)
    return LiftedMass(along / gravity, std / gravity, float(np.linalg.norm(change - along * towards)), 2 * std)
