"""Diagnosis of a recording: where it differs from the simulation, which physics is missing, and the held-out proof.

Rooms, from the ground up; arrows between them run upwards only:

- `recorded`: one recording as effects see it, and the wrench of a rigid load.
- `effects`: the library, one file per effect.
- `reading`: model.yaml, and a recording with the prediction of its nominal model.
- `inference`: noise, calibration errors, fits and the search over hypotheses.
- `answer`: the diagnosis, live windows, and the motion that discriminates between two explanations.
- `application`: a model with effects, put to use.
"""

from poise.mismatch.answer import Diagnosis, diagnose
from poise.mismatch.reading import NominalModel, dump_model, joined, load_model, parse_model, read_recording

__all__ = [
    "Diagnosis",
    "NominalModel",
    "diagnose",
    "dump_model",
    "joined",
    "load_model",
    "parse_model",
    "read_recording",
]
