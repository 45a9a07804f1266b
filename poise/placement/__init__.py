"""Where to put the next object so that it stays.

- `plan_placement`: one object, into an assembly that stands. `Options`: what is required of the placement.
- `plan_sequence`: several objects, in an order that it finds.
- `PLACEMENT_PLANNERS`: planners by name (docs/add_a_planner.md).
- `KeptFree`: a region that stays empty. `Uncertainty`: placements that survive errors of pose, mass and friction.
- `Validator`, `ContactFeatures`: what planners share: tests of a pose, and what an object can rest on.
"""

from poise.placement.features import ContactFeatures
from poise.placement.planner import (
    SUPPORT_KINDS,
    CancelledError,
    Options,
    Placement,
    PlacementProgress,
    no_placement,
    plan_placement,
)
from poise.placement.registry import DEFAULT_PLANNER, PLACEMENT_PLANNERS, PlacementPlanner
from poise.placement.scoring import CRITERIA, PlacementScore, evaluate
from poise.placement.sequence import PlacementSequence, plan_sequence
from poise.placement.uncertainty import Uncertainty
from poise.placement.validation import KeptFree, PlacementTest, PoseTest, Validator, require_new

__all__ = [
    "CRITERIA",
    "DEFAULT_PLANNER",
    "PLACEMENT_PLANNERS",
    "SUPPORT_KINDS",
    "CancelledError",
    "ContactFeatures",
    "KeptFree",
    "Options",
    "Placement",
    "PlacementPlanner",
    "PlacementProgress",
    "PlacementScore",
    "PlacementSequence",
    "PlacementTest",
    "PoseTest",
    "Uncertainty",
    "Validator",
    "evaluate",
    "no_placement",
    "plan_placement",
    "plan_sequence",
    "require_new",
]
