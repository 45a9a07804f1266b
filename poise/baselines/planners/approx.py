"""Planner `approx`: that of Poise, guided by the robustness of model `approx`."""

from functools import partial

from poise.baselines.placement import guided_by
from poise.placement import PlacementPlanner

entry = PlacementPlanner(
    "approx", "contact places guided by the robustness of model approx", partial(guided_by, "approx"), compares=True
)
