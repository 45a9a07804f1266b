"""Model `coulomb`: elastic contacts with Coulomb friction, pushed until something gives way."""

import numpy as np

from poise.assembly.models.limit import limit
from poise.assembly.robustness import Collapses, RobustnessModel, check_elastic
from poise.assembly.statics import BISECTED, Analysis, Deadline, Loads


def coulomb(analysis: Analysis, loads: Loads, deadline: Deadline) -> Collapses:
    """Elastic contacts with Coulomb friction; see `CoulombBlock`. Limit analysis says where to stop looking."""
    collapses = limit(analysis, loads, deadline)
    check_elastic(collapses, analysis, loads, np.ones(loads.count, dtype=bool), deadline, nearly=1.0)
    collapses.upper = np.minimum(collapses.upper, (1 + BISECTED) * collapses.lower)
    return collapses


entry = RobustnessModel(
    "coulomb",
    "elastic contacts that cannot pull, with Coulomb friction without dilatancy",
    coulomb,
)
