"""Models that others proposed, to compare with: the thesis', its approximation, linear programs, a physics engine."""
