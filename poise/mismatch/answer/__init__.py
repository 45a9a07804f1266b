"""The diagnosis: named effects with probabilities, unexplained residuals, the held-out proof, live windows."""

from poise.mismatch.answer.belief import BeliefBasis, belief_probability
from poise.mismatch.answer.diagnosis import Diagnosis, Verdict, diagnose, verdict_of
from poise.mismatch.answer.discriminating_motion import DiscriminatingMotion, design_motion
from poise.mismatch.answer.live_window import LiveWindow, effects_called, examine
from poise.mismatch.answer.named import NamedEffect, Quantity, covariances, quantities
from poise.mismatch.answer.residual_windows import ResidualWindow
from poise.mismatch.answer.signal_diagnosis import SignalDiagnosis

__all__ = [
    "BeliefBasis",
    "Diagnosis",
    "DiscriminatingMotion",
    "LiveWindow",
    "NamedEffect",
    "Quantity",
    "ResidualWindow",
    "SignalDiagnosis",
    "Verdict",
    "belief_probability",
    "covariances",
    "design_motion",
    "diagnose",
    "effects_called",
    "examine",
    "quantities",
    "verdict_of",
]
