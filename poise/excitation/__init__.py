"""Motions that weigh a payload: as much information as the limits allow, and proof that they are kept.

- `limits`: `MotionLimits`, and `Guard`, the points that have to stay slow.
- `hand`: how the hand moves with the joints, with derivatives; `clamped_spline`: from rest to rest in the same place.
- `information`: what a motion's wrenches will tell. `search`: the motion that tells most. `stop_and_go`: the safe case.
- `certificate`: bounds that hold at every instant. `plan`: all of it together.
"""

from poise.excitation.certificate import Certificate, certify, slowed
from poise.excitation.information import Information, PayloadBelief
from poise.excitation.limits import COLLABORATIVE_SPEED, Guard, MotionLimits, tool_centre
from poise.excitation.plan import ExcitationOptions, ExcitationPlan, plan_excitation, plan_stop_and_go
from poise.excitation.search import SearchEffort

__all__ = [
    "COLLABORATIVE_SPEED",
    "Certificate",
    "ExcitationOptions",
    "ExcitationPlan",
    "Guard",
    "Information",
    "MotionLimits",
    "PayloadBelief",
    "SearchEffort",
    "certify",
    "plan_excitation",
    "plan_stop_and_go",
    "slowed",
    "tool_centre",
]
