"""The load that a diagnosis found in one recording, as that which the model of another one has already."""

from dataclasses import replace

import numpy as np

from poise.mismatch.answer import Diagnosis
from poise.mismatch.effects import PAYLOAD_PARAMETERS
from poise.mismatch.recorded import RecordedMotion


def with_known_load(recorded: RecordedMotion, found: Diagnosis) -> RecordedMotion:
    """The recording whose model has the load that a diagnosis found: it may have less of it.

    Its wrench is not added to the prediction: `with_model_effects` does that, and knows what joints have.
    """
    loads = [each for each in found.findings if each.effect.name == "payload_parameters"]
    phi = recorded.phi + sum(np.array([each.values[name] for name in PAYLOAD_PARAMETERS]) for each in loads)
    return replace(recorded, phi=phi)
