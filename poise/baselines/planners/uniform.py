"""Planner `uniform`: that of Poise, without a guide: all places are equally likely."""

from functools import partial

from poise.baselines.placement import guided_by
from poise.placement import PlacementPlanner

entry = PlacementPlanner(
    "uniform",
    "contact places without a guide: all places are equally likely",
    partial(guided_by, "uniform"),
    compares=True,
)
