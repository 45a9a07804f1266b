"""Model `patch`: one wrench per interface, friction as under uniform pressure."""

from poise.assembly.robustness import LimitLoads, RobustnessModel, ask_block, ask_single_patch, patch_factors
from poise.assembly.statics import Analysis, Deadline, Loads


def patch(analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """One wrench per interface, friction as under uniform pressure; see `SinglePatch` and `PatchProgram`."""
    limit_loads = LimitLoads.start(loads.count)
    for block in analysis.blocks:
        questions, block_loads = block.loads(loads)
        ask_single_patch(limit_loads, block, questions, block_loads)
        if block.solvers.single_patch is None:
            ask_block(limit_loads, block, questions, block_loads, deadline, patch_factors)
    return limit_loads


entry = RobustnessModel(
    "patch", "one wrench per interface, with friction as under uniform pressure", patch, maps=True, certified=True
)
