"""How hard an assembly can be pushed and accelerated, and in which order it can be taken apart.

- `registry`, `limit_loads`, `block_answers`: models by name, their results, and what they share.
- `assess`, `maps`, `elastic_maps`: single pushes, and maps of the surface.
- `pose_intervals`: intervals over uncertain poses.
- `sensitivity`, `uncertainty`: derivatives of robustness, and the probability that something moves.
- `acceleration`, `turning_base`: limits of an accelerating, turning and tilted base. `disassembly`: orders of removal.
- `rolling_findings`: sentences about what stands but can roll, or balances; `gap_findings`: what touches across gaps.
- `likely_cause`, `other_readings`: sentences about what is refused or falls, by other readings of the scene.
"""

from poise.assembly.robustness.acceleration import AccelerationLimits, acceleration_limits
from poise.assembly.robustness.assess import Assessment, Robustness, assess
from poise.assembly.robustness.block_answers import (
    CHECKED_WEIGHTS,
    ask_block,
    ask_single_limit,
    ask_single_patch,
    both_factors,
    check_elastic,
    coupled_questions,
    limit_factors,
    patch_factors,
)
from poise.assembly.robustness.disassembly import Disassembly, plan_disassembly
from poise.assembly.robustness.gap_findings import gap_findings
from poise.assembly.robustness.likely_cause import EXPLAINED, likely_cause
from poise.assembly.robustness.limit_loads import LimitLoads, PlainMovement
from poise.assembly.robustness.maps import MAX_MAP_POINTS, RobustnessMap, robustness_map, rough_robustness
from poise.assembly.robustness.patch_answers import ask_patches
from poise.assembly.robustness.pose_intervals import SAMPLES, UncertainAssessment, assess_settled, carried
from poise.assembly.robustness.registry import DEFAULT_MODEL, ROBUSTNESS_MODELS, RobustnessModel
from poise.assembly.robustness.rolling_findings import balance_findings, rolling_findings
from poise.assembly.robustness.sensitivity import Sensitivity, sensitivity
from poise.assembly.robustness.turning_base import TurningBase
from poise.assembly.robustness.uncertainty import MotionProbability, motion_probability

__all__ = [
    "CHECKED_WEIGHTS",
    "DEFAULT_MODEL",
    "EXPLAINED",
    "MAX_MAP_POINTS",
    "ROBUSTNESS_MODELS",
    "SAMPLES",
    "AccelerationLimits",
    "Assessment",
    "Disassembly",
    "LimitLoads",
    "MotionProbability",
    "PlainMovement",
    "Robustness",
    "RobustnessMap",
    "RobustnessModel",
    "Sensitivity",
    "TurningBase",
    "UncertainAssessment",
    "acceleration_limits",
    "ask_block",
    "ask_patches",
    "ask_single_limit",
    "ask_single_patch",
    "assess",
    "assess_settled",
    "balance_findings",
    "both_factors",
    "carried",
    "check_elastic",
    "coupled_questions",
    "gap_findings",
    "likely_cause",
    "limit_factors",
    "motion_probability",
    "patch_factors",
    "plan_disassembly",
    "robustness_map",
    "rolling_findings",
    "rough_robustness",
    "sensitivity",
]
