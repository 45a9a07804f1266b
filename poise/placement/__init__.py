"""Where to put the next object so that it stays.

- `plan_placement`: one object, into an assembly that stands. `Options`: what is wanted of the placement.
- `plan_sequence`: several objects, in an order that it finds.
- `KeptFree`: a room into which nothing is put.
- `Uncertainty`: placements that survive errors of pose, mass and friction.
"""

from poise.placement.judging import CRITERIA, Merit, judge
from poise.placement.planner import CancelledError, Options, Placement, Progress, plan_placement
from poise.placement.sequence import PlacementSequence, plan_sequence
from poise.placement.uncertainty import Uncertainty
from poise.placement.validation import KeptFree

__all__ = [
    "CRITERIA",
    "CancelledError",
    "KeptFree",
    "Merit",
    "Options",
    "Placement",
    "PlacementSequence",
    "Progress",
    "Uncertainty",
    "judge",
    "plan_placement",
    "plan_sequence",
]
