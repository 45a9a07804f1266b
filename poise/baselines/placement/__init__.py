"""Shared code of the placement planners for comparison.

- `engine`: an assembly in MuJoCo. `dropping`: objects that come to rest.
- `trials`: tests of sampled poses one by one.
"""

from poise.baselines.placement.dropping import from_above, from_anywhere
from poise.baselines.placement.engine import Engine, holds
from poise.baselines.placement.trials import at_random, first_that_stays, guided_by, radius, surroundings

__all__ = [
    "Engine",
    "at_random",
    "first_that_stays",
    "from_above",
    "from_anywhere",
    "guided_by",
    "holds",
    "radius",
    "surroundings",
]
