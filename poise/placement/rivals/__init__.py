"""Planners that others proposed, to compare with: by simulation, by heightmap, by chance (thesis section 5.6.1)."""
