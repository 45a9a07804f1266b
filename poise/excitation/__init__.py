"""Motions for weighing a payload: the most information within the limits, and a certificate of these limits.

- `limits`: `MotionLimits`, and `Guard`, the points whose speed is limited.
- `hand`: the motion of the hand from that of the joints, with derivatives; `clamped_spline`: from rest to rest.
- `information`: Fisher information of the wrenches of a motion. `search`: the most informative motion.
- `stop_and_go`: a few poses at rest. `certificate`: bounds that hold at every instant.
- `plan`: the complete planning; `plan_file`: a plan as YAML. `execution`: the supervised execution of a plan.
"""

from poise.excitation.certificate import Certificate, certify, joint_peaks, slowed
from poise.excitation.hand import HandMotion, hand_motion
from poise.excitation.information import Information, PayloadBelief
from poise.excitation.limits import COLLABORATIVE_SPEED, Guard, MotionLimits, tool_centre
from poise.excitation.plan import ExcitationOptions, ExcitationPlan, plan_excitation, plan_stop_and_go
from poise.excitation.plan_file import write_plan, write_waypoints
from poise.excitation.search import SearchEffort

__all__ = [
    "COLLABORATIVE_SPEED",
    "Certificate",
    "ExcitationOptions",
    "ExcitationPlan",
    "Guard",
    "HandMotion",
    "Information",
    "MotionLimits",
    "PayloadBelief",
    "SearchEffort",
    "certify",
    "hand_motion",
    "joint_peaks",
    "plan_excitation",
    "plan_stop_and_go",
    "slowed",
    "tool_centre",
    "write_plan",
    "write_waypoints",
]
