"""Model `limit`: limit analysis with exact Coulomb cones at the corners of every interface."""

from poise.assembly.robustness import Collapses, RobustnessModel, ask_block, limit_gauges
from poise.assembly.statics import Analysis, Deadline, Loads


def limit(analysis: Analysis, loads: Loads, deadline: Deadline) -> Collapses:
    """Exact-cone limit analysis; see `limit.limit_program`."""
    collapses = Collapses.start(loads.count)
    for block in analysis.blocks:
        ask_block(collapses, block, *block.loads(loads), deadline, limit_gauges)
    return collapses


entry = RobustnessModel(
    "limit",
    "any contact forces within exact Coulomb cones at the corners of each interface",
    limit,
    maps=True,
    certified=True,
)
