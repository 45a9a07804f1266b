"""Recordings: reading and writing mcap bags, and aligning their streams in time."""

from poise.recording.streams import ImuStream, JointStream, PoseStream, Stream, WrenchStream

__all__ = ["ImuStream", "JointStream", "PoseStream", "Stream", "WrenchStream"]
