"""Fits of effects to a signal: noise, calibration errors, evidence, and the search over hypotheses."""

from poise.mismatch.inference.calibration import SIGMAS, payload_steps
from poise.mismatch.inference.fitting import Fit, fit, ground, refine
from poise.mismatch.inference.heldout import HeldOut, held_out, tail
from poise.mismatch.inference.noise import Noise
from poise.mismatch.inference.problem import Part, Problem, effort_problem, wrench_problem
from poise.mismatch.inference.search import WARM, Search, left_over, names, search
from poise.mismatch.inference.unknown import Dependence, Shape, hats, shape, spoken

__all__ = [
    "SIGMAS",
    "WARM",
    "Dependence",
    "Fit",
    "HeldOut",
    "Noise",
    "Part",
    "Problem",
    "Search",
    "Shape",
    "effort_problem",
    "fit",
    "ground",
    "hats",
    "held_out",
    "left_over",
    "names",
    "payload_steps",
    "refine",
    "search",
    "shape",
    "spoken",
    "tail",
    "wrench_problem",
]
