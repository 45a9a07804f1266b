"""Diagnosis of a recording: its differences from the simulation, the missing effects, and the held-out proof.

Rooms, from the ground up; arrows between them run upwards only:

- `recorded`: one recording in the form that effects use, and the wrench of a rigid load.
- `effects`: the library, one file per effect.
- `reading`: model.yaml, and a recording with the prediction of its nominal model.
- `inference`: noise, calibration errors, fits and the search over hypotheses.
- `answer`: the diagnosis, live windows, and the motion that discriminates between two explanations.
- `comparing`: what changed between two recordings.
- `application`: simulation and compensation with the identified effects.
- `carried`: a scene on a base that moves, held against the assembly engine.
"""

from poise.mismatch.answer import Diagnosis, diagnose
from poise.mismatch.comparing import Comparison, compare
from poise.mismatch.reading import NominalModel, dump_model, joined, load_model, parse_model, read_recording

__all__ = [
    "Comparison",
    "Diagnosis",
    "NominalModel",
    "compare",
    "diagnose",
    "dump_model",
    "joined",
    "load_model",
    "parse_model",
    "read_recording",
]
