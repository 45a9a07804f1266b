"""Model `default`: the weaker of `limit` and `patch`, checked by elastic contacts."""

import numpy as np

from poise.assembly.robustness import (
    LimitLoads,
    RobustnessModel,
    ask_block,
    ask_single_patch,
    both_factors,
    check_elastic,
    limit_factors,
)
from poise.assembly.statics import Analysis, Deadline, Loads, Mechanism

_CHECKED_ANSWERS = 8
"""Number of weakest answers that elastic contacts check, besides all that may depend on self-stress."""


def default(analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """The weaker of `limit` and `patch`; the weakest, and what may rest on self-stress, checked by `coulomb`."""
    limit_loads = LimitLoads.start(loads.count)
    doubtful = np.zeros(loads.count, dtype=bool)
    for block in analysis.blocks:
        questions, block_loads = block.loads(loads)
        doubtful[questions] |= block.solvers.self_stress
        single = block.solvers.single_patch is not None
        ask_single_patch(limit_loads, block, questions, block_loads)
        ask_block(limit_loads, block, questions, block_loads, deadline, limit_factors if single else both_factors)
    # One body on one interface has no choice of contact forces.
    free = [isinstance(m, Mechanism) and not m.block.geometry.statically_determinate for m in limit_loads.mechanisms]
    weakest = np.argsort(np.where(free, limit_loads.upper, np.inf))[:_CHECKED_ANSWERS]
    doubtful[weakest] |= np.array(free, dtype=bool)[weakest]
    check_elastic(limit_loads, analysis, loads, doubtful, deadline)
    return limit_loads


entry = RobustnessModel(
    "default",
    "the weaker of limit and patch; the weakest answers are checked by coulomb",
    default,
    maps=True,
    certified=True,
)
