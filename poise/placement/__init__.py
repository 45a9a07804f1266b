"""Stable placements of the next objects.

- `plan_placement`: one object, into a stable assembly. `Options`: requirements on the placement.
- `plan_sequence`: several objects, and the order in which to place them.
- `PackingOptions`: how a container is packed; the planner is `poise.placement.packing`.
- `PLACEMENT_PLANNERS`: planners by name (docs/add_a_planner.md).
- `Upright`: axes that may point up. `KeptFree`: a region that must stay empty.
- `Uncertainty`: placements that survive errors of pose, mass and friction.
- `Steady`, `rise_to_tip`: placements from which the object does not tip easily. `steady_faces`: what it stands on.
- `cause_of`, `no_placement`: why there is no placement.
- `Validator`, `ContactFeatures`: shared by planners: tests of a pose, and features that an object can rest on.
"""

from poise.placement.features import ContactFeatures, steady_faces
from poise.placement.orientation import TURNED, Upright
from poise.placement.planner import (
    SUPPORT_KINDS,
    CancelledError,
    Options,
    PackingOptions,
    Placement,
    PlacementProgress,
    plan_placement,
)
from poise.placement.refusals import cause_of, no_placement
from poise.placement.registry import DEFAULT_PLANNER, PLACEMENT_PLANNERS, PlacementPlanner
from poise.placement.scoring import CRITERIA, PlacementScore, evaluate
from poise.placement.sequence import PlacementSequence, plan_sequence, require_distinct
from poise.placement.steadiness import Steady, rise_to_tip, tipping_rise
from poise.placement.uncertainty import Uncertainty
from poise.placement.validation import KeptFree, PlacementTest, PoseTest, Validator, kept_free, require_new

__all__ = [
    "CRITERIA",
    "DEFAULT_PLANNER",
    "PLACEMENT_PLANNERS",
    "SUPPORT_KINDS",
    "TURNED",
    "CancelledError",
    "ContactFeatures",
    "KeptFree",
    "Options",
    "PackingOptions",
    "Placement",
    "PlacementPlanner",
    "PlacementProgress",
    "PlacementScore",
    "PlacementSequence",
    "PlacementTest",
    "PoseTest",
    "Steady",
    "Uncertainty",
    "Upright",
    "Validator",
    "cause_of",
    "evaluate",
    "kept_free",
    "no_placement",
    "plan_placement",
    "plan_sequence",
    "require_distinct",
    "require_new",
    "rise_to_tip",
    "steady_faces",
    "tipping_rise",
]
