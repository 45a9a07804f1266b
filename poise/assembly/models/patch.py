"""Model `patch`: one wrench per interface, friction as under uniform pressure."""

from poise.assembly.robustness import Collapses, RobustnessModel, ask_block, ask_single_patch, patch_gauges
from poise.assembly.statics import Analysis, Deadline, Loads


def patch(analysis: Analysis, loads: Loads, deadline: Deadline) -> Collapses:
    """One wrench per interface, friction as under uniform pressure; see `SinglePatch` and `PatchProgram`."""
    collapses = Collapses.start(loads.count)
    for block in analysis.blocks:
        questions, block_loads = block.loads(loads)
        ask_single_patch(collapses, block, questions, block_loads)
        if block.solvers.single_patch is None:
            ask_block(collapses, block, questions, block_loads, deadline, patch_gauges)
    return collapses


entry = RobustnessModel(
    "patch", "one wrench per interface, with friction as under uniform pressure", patch, maps=True, certified=True
)
