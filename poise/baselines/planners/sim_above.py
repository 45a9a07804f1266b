"""Planner `sim-above`: the object is dropped from above in a physics engine (thesis section 5.6.1)."""

from functools import partial

from poise.baselines.placement import first_that_stays, from_above
from poise.placement import PlacementPlanner

entry = PlacementPlanner(
    "sim-above",
    "where the object comes to rest, dropped from above in a physics engine",
    partial(first_that_stays, from_above),
    needs=("mujoco",),
    extra="sim",
)
