"""Fits of effects to a signal: noise, calibration errors, evidence, and the search over hypotheses."""

from poise.mismatch.inference.added_effect import EffectCandidate, refine
from poise.mismatch.inference.calibration import payload_steps
from poise.mismatch.inference.coarse import averaged_efforts
from poise.mismatch.inference.fitting import HypothesisFit, exceeds_tolerance, fit, linearization_point
from poise.mismatch.inference.heldout import HeldOutProof, held_out, relative_error, tail
from poise.mismatch.inference.hypotheses import WARM_STEPS, HypothesisSearch, alike, names, residual_of
from poise.mismatch.inference.noise import SignalNoise
from poise.mismatch.inference.problem import FittedEffect, Problem, effort_problem, wrench_problem
from poise.mismatch.inference.proof import MATERIAL_EXCESS, EffectProof, ProvenModel, allowed_excess, proven
from poise.mismatch.inference.replacements import EQUAL_EVIDENCE, LOOKALIKE, NEAR_SHARE, improved, replacements
from poise.mismatch.inference.search import alone_in_efforts, found_in_efforts, search
from poise.mismatch.inference.standstill import beside_stuck_joints
from poise.mismatch.inference.time_limit import TimeLimit
from poise.mismatch.inference.unknown import (
    Dependence,
    DependenceCurve,
    FreeCurve,
    dependence_curve,
    linear_bspline_basis,
    state_description,
)
from poise.mismatch.inference.variations import Variation, variations

__all__ = [
    "EQUAL_EVIDENCE",
    "LOOKALIKE",
    "MATERIAL_EXCESS",
    "NEAR_SHARE",
    "WARM_STEPS",
    "Dependence",
    "DependenceCurve",
    "EffectCandidate",
    "EffectProof",
    "FittedEffect",
    "FreeCurve",
    "HeldOutProof",
    "HypothesisFit",
    "HypothesisSearch",
    "Problem",
    "ProvenModel",
    "SignalNoise",
    "TimeLimit",
    "Variation",
    "alike",
    "allowed_excess",
    "alone_in_efforts",
    "averaged_efforts",
    "beside_stuck_joints",
    "dependence_curve",
    "effort_problem",
    "exceeds_tolerance",
    "fit",
    "found_in_efforts",
    "held_out",
    "improved",
    "linear_bspline_basis",
    "linearization_point",
    "names",
    "payload_steps",
    "proven",
    "refine",
    "relative_error",
    "replacements",
    "residual_of",
    "search",
    "state_description",
    "tail",
    "variations",
    "wrench_problem",
]
