"""From a recording and model.yaml to a recorded motion with the prediction of the nominal model."""

from poise.mismatch.reading.joining import joined, spans, without
from poise.mismatch.reading.kinematics import Motion, base_joints, effort_track, world_from_motion
from poise.mismatch.reading.model_effects import absent, effect_of, with_components
from poise.mismatch.reading.nominal_model import Component, NominalModel, Tolerance, dump_model, load_model, parse_model
from poise.mismatch.reading.payload import identified
from poise.mismatch.reading.recordings import Reading, read_world

__all__ = [
    "Component",
    "Motion",
    "NominalModel",
    "Reading",
    "Tolerance",
    "absent",
    "base_joints",
    "dump_model",
    "effect_of",
    "effort_track",
    "identified",
    "joined",
    "load_model",
    "parse_model",
    "read_world",
    "spans",
    "with_components",
    "without",
    "world_from_motion",
]
