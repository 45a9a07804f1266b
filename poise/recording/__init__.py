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
from poise.recording.encoding import LATCHED_TOPICS, encode_stream, encode_text, typestore
from poise.recording.folders import find_recordings, is_recording, skipped_entries
from poise.recording.images import (
    CLOUD,
    COMPRESSED,
    IMAGE,
    INFO,
    Image,
    encoding_of,
    image_of,
    messages_of,
    stamps_of,
)
from poise.recording.live_messages import header_of, joint_states_in, wrenches_in
from poise.recording.reading import RawMessage, Recording, Topic, open_recording
from poise.recording.rewriting import rewrite_recording
from poise.recording.streams import ImuStream, JointStream, PoseStream, Stream, WrenchStream, stamp_of
from poise.recording.timeline import MAX_LATENESS
from poise.recording.trajectories import joint_commands, trajectories_in
from poise.recording.writing import RecordingWriter, write_recording

__all__ = [
    "CLOUD",
    "COMPRESSED",
    "IMAGE",
    "INFO",
    "LATCHED_TOPICS",
    "MAX_LATENESS",
    "Image",
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
    "encode_stream",
    "encode_text",
    "encoding_of",
    "find_recordings",
    "header_of",
    "image_of",
    "interpolate",
    "interpolate_rotations",
    "is_recording",
    "joint_commands",
    "joint_states_in",
    "messages_of",
    "nearest",
    "open_recording",
    "resample",
    "rewrite_recording",
    "skipped_entries",
    "stamp_of",
    "stamps_of",
    "trajectories_in",
    "typestore",
    "wrenches_in",
    "write_recording",
]
