"""Model `limit`: limit analysis with exact Coulomb cones at the corners of every interface."""

from poise.assembly.robustness import LimitLoads, RobustnessModel, ask_block, limit_factors
from poise.assembly.statics import Analysis, Deadline, Loads


def limit(analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """Exact-cone limit analysis; see `limit.limit_program`."""
    limit_loads = LimitLoads.start(loads.count)
    for block in analysis.blocks:
        ask_block(limit_loads, block, *block.loads(loads), deadline, limit_factors)
    return limit_loads


entry = RobustnessModel(
    "limit",
    "any contact forces within exact Coulomb cones at the corners of each interface",
    limit,
    maps=True,
    certified=True,
)
