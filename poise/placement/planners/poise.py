"""Planner `poise`: contact places first, pose second, guided by robustness (thesis Algorithm 5)."""

from poise.placement import PlacementPlanner, plan_placement, plan_sequence

entry = PlacementPlanner(
    "poise",
    "contact places guided by robustness, the best of several placements",
    plan_placement,
    compares=True,
    plan_several=plan_sequence,
)
