"""Recordings: reading and writing mcap bags, and aligning their streams in time."""

from poise.recording.blocks import Loss, LossKind
from poise.recording.reading import RawMessage, Recording, Topic, open_recording
from poise.recording.streams import ImuStream, JointStream, PoseStream, Stream, WrenchStream
from poise.recording.writing import RecordingWriter, write_recording

__all__ = [
    "ImuStream",
    "JointStream",
    "Loss",
    "LossKind",
    "PoseStream",
    "RawMessage",
    "Recording",
    "RecordingWriter",
    "Stream",
    "Topic",
    "WrenchStream",
    "open_recording",
    "write_recording",
]
