"""Planner `chance`: poses anywhere in the vicinity of the objects (thesis section 5.6.1)."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from poise.assembly import Analysis, RigidObject
from poise.baselines.placement import at_random, first_that_stays, radius, surroundings
from poise.geometry import Pose
from poise.placement import PlacementPlanner


def anywhere(analysis: Analysis, item: RigidObject, rng: np.random.Generator) -> Iterator[Pose]:
    """Random poses, without end."""
    bounds = surroundings(analysis, radius(item))
    while True:
        yield at_random(item, rng, np.asarray(rng.uniform(*bounds)))


entry = PlacementPlanner("chance", "random poses near the objects", partial(first_that_stays, anywhere))
