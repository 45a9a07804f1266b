"""Placement planners for comparison, one file each, found by the registry of `poise.placement`."""

__all__: list[str] = []
