"""Model `default`: the weaker of `limit` and `patch`, checked by elastic contacts."""

from poise.assembly.robustness import (
    LimitLoads,
    RobustnessModel,
    ask_block,
    ask_patches,
    ask_single_limit,
    ask_single_patch,
    check_elastic,
    coupled_questions,
    limit_factors,
)
from poise.assembly.statics import Analysis, Deadline, Loads


def default(analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """The weaker of `limit` and `patch`; where contact forces have a choice, `coulomb` checks every answer."""
    limit_loads = LimitLoads.start(loads.count)
    asked = [(block, *block.loads(loads)) for block in analysis.blocks]
    for question in asked:
        ask_single_patch(limit_loads, *question)
    coupled = []
    for block, questions, block_loads in asked:
        if block.solvers.single_patch is not None:
            ask_single_limit(limit_loads, block, questions, block_loads, deadline)
            continue
        limits = ask_block(limit_loads, block, questions, block_loads, deadline, limit_factors)
        coupled.append((block, questions, block_loads, limits))
    elastic = check_elastic(limit_loads, analysis, loads, coupled_questions(analysis, loads), deadline)
    for block, questions, block_loads, limits in coupled:
        ask_patches(limit_loads, block, questions, block_loads, deadline, limits, elastic)
    return limit_loads


entry = RobustnessModel(
    "default",
    "the weaker of limit and patch, checked by coulomb where contact forces have a choice",
    default,
    maps=True,
    certified=True,
)
