"""Model `default`: the weaker of `limit` and `patch`, checked by elastic contacts."""

from poise.assembly.robustness import (
    LimitLoads,
    RobustnessModel,
    ask_block,
    ask_patches,
    ask_single_patch,
    check_elastic,
    coupled_questions,
    limit_factors,
)
from poise.assembly.statics import Analysis, Deadline, Loads


def default(analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """The weaker of `limit` and `patch`; where contact forces have a choice, `coulomb` checks every answer."""
    limit_loads = LimitLoads.start(loads.count)
    asked = []
    for block in analysis.blocks:
        questions, block_loads = block.loads(loads)
        ask_single_patch(limit_loads, block, questions, block_loads)
        limits = ask_block(limit_loads, block, questions, block_loads, deadline, limit_factors)
        asked.append((block, questions, block_loads, limits))
    elastic = check_elastic(limit_loads, analysis, loads, coupled_questions(analysis, loads), deadline)
    for block, questions, block_loads, limits in asked:
        ask_patches(limit_loads, block, questions, block_loads, deadline, limits, elastic)
    return limit_loads


entry = RobustnessModel(
    "default",
    "the weaker of limit and patch, checked by coulomb where contact forces have a choice",
    default,
    maps=True,
    certified=True,
)
