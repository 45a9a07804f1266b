"""Recordings: reading bags and tables, writing mcap bags, and aligning streams in time."""

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
from poise.recording.folders import find_recordings
from poise.recording.reading import RawMessage, Recording, Topic, open_recording
from poise.recording.rewriting import rewrite_recording
from poise.recording.streams import ImuStream, JointStream, PoseStream, Stream, WrenchStream
from poise.recording.trajectories import joint_commands
from poise.recording.writing import RecordingWriter, write_recording

__all__ = [
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
    "find_recordings",
    "interpolate",
    "interpolate_rotations",
    "joint_commands",
    "nearest",
    "open_recording",
    "resample",
    "rewrite_recording",
    "write_recording",
]
