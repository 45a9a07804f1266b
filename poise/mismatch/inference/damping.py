"""Damping of the steps of a fit (Levenberg-Marquardt)."""

SETTLED = 0.1
"""Decrease of the square at which a fit has converged."""


class Damping:
    """Damping of a step, in units of each parameter's own curvature (Marquardt 1963)."""

    def __init__(self) -> None:
        self._now = 1e-6

    def tries(self) -> list[float]:
        """Damping strengths to try, from the last successful one upwards."""
        return [max(self._now * 100.0**k, 1e-3 if k else 0.0) for k in range(4) if self._now * 100.0**k < 1e3]

    def eased(self, strength: float) -> None:
        """Reduce the damping after a successful step."""
        self._now = max(strength / 30.0, 1e-6)
