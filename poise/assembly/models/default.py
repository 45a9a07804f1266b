"""Model `default`: the weaker of `limit` and `patch`, checked by elastic contacts."""

from poise.assembly.robustness import (
    LimitLoads,
    RobustnessModel,
    ask_block,
    ask_single_patch,
    both_factors,
    check_elastic,
    coupled_questions,
    limit_factors,
)
from poise.assembly.statics import Analysis, Deadline, Loads


def default(analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """The weaker of `limit` and `patch`; where contact forces have a choice, `coulomb` checks every answer."""
    limit_loads = LimitLoads.start(loads.count)
    for block in analysis.blocks:
        questions, block_loads = block.loads(loads)
        single = block.solvers.single_patch is not None
        ask_single_patch(limit_loads, block, questions, block_loads)
        ask_block(limit_loads, block, questions, block_loads, deadline, limit_factors if single else both_factors)
    check_elastic(limit_loads, analysis, loads, coupled_questions(analysis, loads), deadline)
    return limit_loads


entry = RobustnessModel(
    "default",
    "the weaker of limit and patch, checked by coulomb where contact forces have a choice",
    default,
    maps=True,
    certified=True,
)
