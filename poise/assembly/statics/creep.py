"""Where bodies creep to on viscous bonds, from where they are: for Newton steps that are stuck from afar."""

from collections.abc import Callable

import numpy as np

from poise.assembly.statics.elastic_state import ElasticState
from poise.types import Array

CREEP_STEPS = 25
"""Newton steps in each step in time."""
_ROUNDS, _SOFTER, _STIFFER, _STIFFEST = 40, 4.0, 8.0, 10.0
"""Steps in time; by how much bonds become softer after one that was found, and stiffer after one that was not, up to so
many times the mean stiffness of contacts."""


def creep(
    step: Callable[[Array, float], Array | None], state: Callable[[Array], ElasticState | None], size: int
) -> ElasticState | None:
    """The state to which bodies creep under a load, or that they fall; None where neither is found.

    From afar, Newton steps may be stuck where many contacts change. On viscous bonds to the ground each step in time
    has an equilibrium near the one before, which they find (pseudo-transient continuation: Kelley, Keyes 1998).

    Args:
        step: the displacement (size,) after a step from one, on bonds of a stiffness; None where it is not found.
        state: what is known at a displacement without bonds; None where the bodies still creep.
        size: 6 for each body.
    """
    at, bond = np.zeros(size), 1.0
    for _ in range(_ROUNDS):
        if (moved := step(at, bond)) is not None:
            at, bond = moved, bond / _SOFTER
            if (found := state(at)) is not None:
                return found
        elif (bond := _STIFFER * bond) > _STIFFEST:
            break
    return None
