"""Standard gravity, and the default gravity vector."""

STANDARD_GRAVITY = 9.80665
"""m/s2 (3rd CGPM, 1901)."""

GRAVITY_IN_WORLD = (0.0, 0.0, -STANDARD_GRAVITY)
"""m/s2, the default gravity vector: world z is up."""
