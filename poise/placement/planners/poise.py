"""Planner `poise`: contact places first, pose second, guided by robustness (thesis Algorithm 5)."""

from poise.placement import PlacementPlanner, plan_placement

entry = PlacementPlanner(
    "poise",
    "contact places guided by robustness, the best of several placements",
    plan_placement,
    compares=True,
    sequences=True,
)
