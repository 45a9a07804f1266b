"""Planner `chance`: poses anywhere in the vicinity of the objects (thesis section 5.6.1)."""

from collections.abc import Iterator

import numpy as np

from poise.assembly.analysis import Analysis
from poise.assembly.scene import RigidObject
from poise.geometry import Pose
from poise.placement.rivals.trials import at_random, radius, surroundings


def anywhere(analysis: Analysis, item: RigidObject, rng: np.random.Generator) -> Iterator[Pose]:
    """Random poses, without end."""
    bounds = surroundings(analysis, radius(item))
    while True:
        yield at_random(item, rng, np.asarray(rng.uniform(*bounds)))
