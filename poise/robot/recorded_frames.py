"""The transforms of a recording from a frame upwards."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.recording import PoseStream, Recording

_LEVELS = 100
"""Frames that are climbed at most."""


def frames_above(
    recording: Recording, frame: str, base_frame: str | None = None, strict: bool = False
) -> list[PoseStream]:
    """Transforms of a frame in its parent, of the parent in its own, and so on up to the base.

    Args:
        recording: with tf or tf_static.
        frame: where to begin.
        base_frame: where to end; None: the topmost frame.
        strict: fail when there is none, or when a frame is ambiguous; else end there.

    Raises:
        InputError: FRAME_UNKNOWN when tf forms a circle, or, if strict, as `Recording.poses`.
    """
    streams: list[PoseStream] = []
    while frame != base_frame and len(streams) < _LEVELS:
        try:
            stream = recording.poses(frame)
        except InputError as error:
            top = error.code is ErrorCode.FRAME_UNKNOWN and bool(streams) and base_frame is None
            if strict and not top:
                raise
            break
        if any(stream.parent in (frame, other.child) for other in streams):
            if not strict:
                break
            raise InputError(ErrorCode.FRAME_UNKNOWN, f"{recording.path}: tf forms a circle at {stream.parent}")
        streams.append(stream)
        frame = stream.parent
    return streams


def is_constant(stream: PoseStream) -> bool:
    """All samples of a transform are equal."""
    rotation, translation = stream.rotation_parent_child, stream.translation_parent_child
    return bool(len(stream) and np.all(rotation == rotation[:1]) and np.all(translation == translation[:1]))
