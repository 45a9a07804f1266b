"""Where to put the next object so that it stays.

- `plan_placement`: one object, into an assembly that stands. `Options`: what is wanted of the placement.
- `Uncertainty`: placements that survive errors of pose, mass and friction.
"""

from poise.placement.judging import CRITERIA, Merit, judge
from poise.placement.planner import CancelledError, Options, Placement, Progress, plan_placement
from poise.placement.uncertainty import Uncertainty

__all__ = [
    "CRITERIA",
    "CancelledError",
    "Merit",
    "Options",
    "Placement",
    "Progress",
    "Uncertainty",
    "judge",
    "plan_placement",
]
