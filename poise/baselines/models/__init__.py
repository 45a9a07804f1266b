"""Robustness models for comparison, one file each, found by the registry of `poise.assembly.robustness`."""

__all__: list[str] = []
