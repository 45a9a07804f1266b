"""Planner `sim-random`: the object is released anywhere in a physics engine (thesis section 5.6.1)."""

from functools import partial

from poise.baselines.placement import first_that_stays, from_anywhere
from poise.placement import PlacementPlanner

entry = PlacementPlanner(
    "sim-random",
    "where the object comes to rest, released anywhere in a physics engine",
    partial(first_that_stays, from_anywhere),
    needs=("mujoco",),
    extra="sim",
)
