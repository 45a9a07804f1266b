"""Model `default`: the weaker of `limit` and `patch`, checked by elastic contacts."""

import numpy as np

from poise.assembly.robustness import (
    Collapses,
    RobustnessModel,
    ask_block,
    ask_single_patch,
    both_gauges,
    check_elastic,
    limit_gauges,
)
from poise.assembly.statics import Analysis, Deadline, Loads, Mechanism

CHECKED_ANSWERS = 8
"""Number of weakest answers that elastic contacts check, besides all that may depend on self-stress."""


def default(analysis: Analysis, loads: Loads, deadline: Deadline) -> Collapses:
    """The weaker of `limit` and `patch`; the weakest, and what may rest on self-stress, checked by `coulomb`."""
    collapses = Collapses.start(loads.count)
    doubtful = np.zeros(loads.count, dtype=bool)
    for block in analysis.blocks:
        questions, block_loads = block.loads(loads)
        doubtful[questions] |= block.solvers.self_stress
        single = block.solvers.single_patch is not None
        ask_single_patch(collapses, block, questions, block_loads)
        ask_block(collapses, block, questions, block_loads, deadline, limit_gauges if single else both_gauges)
    # One body on one interface has no choice of contact forces.
    free = [isinstance(m, Mechanism) and not m.block.geometry.statically_determinate for m in collapses.mechanisms]
    weakest = np.argsort(np.where(free, collapses.upper, np.inf))[:CHECKED_ANSWERS]
    doubtful[weakest] |= np.array(free, dtype=bool)[weakest]
    check_elastic(collapses, analysis, loads, doubtful, deadline)
    return collapses


entry = RobustnessModel(
    "default",
    "the weaker of limit and patch; the weakest answers are checked by coulomb",
    default,
    maps=True,
    certified=True,
)
