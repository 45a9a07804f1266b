"""Recordings: reading and writing mcap bags, and aligning their streams in time."""

from poise.recording.alignment import (
    Interpolated,
    Pairing,
    Reason,
    interpolate,
    interpolate_rotations,
    nearest,
    resample,
)
from poise.recording.blocks import Loss, LossKind
from poise.recording.reading import RawMessage, Recording, Topic, open_recording
from poise.recording.rewriting import rewrite_recording
from poise.recording.streams import ImuStream, JointStream, PoseStream, Stream, WrenchStream
from poise.recording.timeline import MAX_LATENESS
from poise.recording.writing import RecordingWriter, write_recording

__all__ = [
    "MAX_LATENESS",
    "ImuStream",
    "Interpolated",
    "JointStream",
    "Loss",
    "LossKind",
    "Pairing",
    "PoseStream",
    "RawMessage",
    "Reason",
    "Recording",
    "RecordingWriter",
    "Stream",
    "Topic",
    "WrenchStream",
    "interpolate",
    "interpolate_rotations",
    "nearest",
    "open_recording",
    "resample",
    "rewrite_recording",
    "write_recording",
]
