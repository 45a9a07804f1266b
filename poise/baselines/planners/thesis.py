"""Planner `thesis`: that of Poise, guided by the robustness of model `thesis`."""

from functools import partial

from poise.baselines.placement import guided_by
from poise.placement import PlacementPlanner

entry = PlacementPlanner(
    "thesis", "contact places guided by the robustness of model thesis", partial(guided_by, "thesis"), compares=True
)
