"""Model `coulomb`: elastic contacts with Coulomb friction, pushed until collapse."""

import numpy as np

from poise.assembly.models.limit import limit
from poise.assembly.robustness import LimitLoads, RobustnessModel, check_elastic
from poise.assembly.statics import FACTOR_TOLERANCE, Analysis, Deadline, Loads


def coulomb(analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """Elastic contacts with Coulomb friction; see `CoulombBlock`. Limit analysis bounds the search from above."""
    limit_loads = limit(analysis, loads, deadline)
    check_elastic(limit_loads, analysis, loads, np.ones(loads.count, dtype=bool), deadline, nearly=1.0)
    collapsed = np.where(limit_loads.checked, (1 + FACTOR_TOLERANCE) * limit_loads.lower, np.inf)
    limit_loads.upper = np.minimum(limit_loads.upper, collapsed)
    return limit_loads


entry = RobustnessModel(
    "coulomb",
    "elastic contacts that cannot pull, with Coulomb friction without dilatancy",
    coulomb,
)
