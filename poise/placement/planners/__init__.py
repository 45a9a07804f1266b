"""Placement planners, one file each, found by the registry of `poise.placement`; see docs/add_a_planner.md."""

__all__: list[str] = []
