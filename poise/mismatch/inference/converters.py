"""Readings of a coarse converter: an effect below half a step cannot be distinguished from their rounding.

Where noise does not move a reading to the next step, the rounding is a function of the load, as an effect is: it is as
large as half a step, and neither smaller on averages nor independent in time.
"""

import numpy as np

from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.recorded import coarse_steps

_ROUNDS = 0.5
"""Steps by which a rounded reading is off at most."""
_NOTHING = 1e-3
"""Share of an effect's largest response, in units of the noise, up to which it does not act in a channel."""


def below_rounding(problem: Problem, part: FittedEffect) -> str:
    """Why the rounding of coarse readings may imitate an effect; "" where it is larger, or acts on others as well."""
    # The readings are those of every model.
    steps = problem.recorded.once(("coarse steps", problem.signal), lambda: coarse_steps(problem.measured))
    if not steps.any():
        return ""
    response = part.effect.simulate(problem.recorded, part.values)[problem.active]
    size = np.abs(response).max(axis=0, initial=0.0)
    acts = size > _NOTHING * float(np.max(size / problem.noise.sigma, initial=0.0)) * problem.noise.sigma
    if not acts.any() or (size[acts] >= _ROUNDS * steps[acts]).any():
        return ""
    return "it is smaller than the rounding of the readings"
