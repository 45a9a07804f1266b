"""The diagnosis: named effects with probabilities, what no effect explains, the held-out proof, live windows."""

from poise.mismatch.answer.belief import MOST_SURE, Basis
from poise.mismatch.answer.diagnosis import Diagnosis, Examination, Finding, Quantity, diagnose
from poise.mismatch.answer.discriminating_motion import Separation, separating_motion
from poise.mismatch.answer.live_window import LiveWindow, effects_called, examine
from poise.mismatch.answer.residual_windows import ResidualWindow

__all__ = [
    "MOST_SURE",
    "Basis",
    "Diagnosis",
    "Examination",
    "Finding",
    "LiveWindow",
    "Quantity",
    "ResidualWindow",
    "Separation",
    "diagnose",
    "effects_called",
    "examine",
    "separating_motion",
]
