"""How far a step of a fit dares to go (Levenberg-Marquardt)."""


class Damping:
    """How strongly a step is held back, in units of each parameter's own curvature (Marquardt 1963)."""

    def __init__(self) -> None:
        self._now = 1e-6

    def tries(self) -> list[float]:
        """From what served last, upwards."""
        return [max(self._now * 100.0**k, 1e-3 if k else 0.0) for k in range(4) if self._now * 100.0**k < 1e3]

    def eased(self, strength: float) -> None:
        """A step at this strength was good: try a longer one next."""
        self._now = max(strength / 30.0, 1e-6)
