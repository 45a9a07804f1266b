"""From a recording and model.yaml to a recorded motion with the prediction of the nominal model."""

from poise.mismatch.reading.bare_motion import bare_motion
from poise.mismatch.reading.commands import recorded_commands, tracking
from poise.mismatch.reading.findings import InputFinding
from poise.mismatch.reading.joining import joined, spans, with_common_efforts, without
from poise.mismatch.reading.joint_motion import seconds_since
from poise.mismatch.reading.joint_names import read_joint_names
from poise.mismatch.reading.kinematics import effort_track, recorded_from_motion
from poise.mismatch.reading.load_on_efforts import LoadOnEfforts, acting_on_efforts, on_efforts, with_rest
from poise.mismatch.reading.measured_streams import MeasuredStreams, holds, recorded_streams
from poise.mismatch.reading.model_effects import (
    absent,
    complete_values,
    effect_of,
    with_joint_physics,
    with_model_effects,
)
from poise.mismatch.reading.nominal_model import (
    ModelEffect,
    NominalModel,
    Tolerance,
    dump_model,
    load_model,
    parse_model,
)
from poise.mismatch.reading.payload import identified
from poise.mismatch.reading.recordings import ReadRecording, read_recording, read_streams
from poise.mismatch.reading.simulator import nominal_description

__all__ = [
    "InputFinding",
    "LoadOnEfforts",
    "MeasuredStreams",
    "ModelEffect",
    "NominalModel",
    "ReadRecording",
    "Tolerance",
    "absent",
    "acting_on_efforts",
    "bare_motion",
    "complete_values",
    "dump_model",
    "effect_of",
    "effort_track",
    "holds",
    "identified",
    "joined",
    "load_model",
    "nominal_description",
    "on_efforts",
    "parse_model",
    "read_joint_names",
    "read_recording",
    "read_streams",
    "recorded_commands",
    "recorded_from_motion",
    "recorded_streams",
    "seconds_since",
    "spans",
    "tracking",
    "with_common_efforts",
    "with_joint_physics",
    "with_model_effects",
    "with_rest",
    "without",
]
