"""Messages as bytes, as a subscription receives them: their headers at once, their content when it is needed."""

import struct
from collections.abc import Sequence

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.recording import decoding
from poise.recording.cdr import Batch, UndecodableError, decode
from poise.recording.streams import JointStream, WrenchStream

_HEADERS = {1: struct.Struct("<iII"), 0: struct.Struct(">iII")}
"""Seconds, nanoseconds and the length of the frame's name, by the byte of the encapsulation that says the order."""
_TEXT = 16
"""Place of the frame's name, behind the encapsulation and these three."""


def header_of(data: bytes) -> tuple[int, bytes]:
    """Stamp in ns and name of the frame of a message with a header, as CDR bytes.

    Raises:
        InputError: TYPE_MISMATCH.
    """
    try:
        seconds, nanoseconds, length = _HEADERS[data[1]].unpack_from(data, 4)
    except (KeyError, IndexError, struct.error) as error:
        raise InputError(ErrorCode.TYPE_MISMATCH, "a message is no CDR with a header: check its publisher") from error
    return seconds * 1_000_000_000 + nanoseconds, data[_TEXT : _TEXT + max(length - 1, 0)]


def wrenches_in(messages: Sequence[bytes]) -> WrenchStream:
    """The wrenches of geometry_msgs/WrenchStamped messages of one frame, as CDR bytes.

    Raises:
        InputError: as `Recording.wrench`.
    """
    return decoding.wrench_stream("wrench", _batches("geometry_msgs/msg/WrenchStamped", messages), _ignore)


def joint_states_in(messages: Sequence[bytes], names: tuple[str, ...] | None) -> JointStream:
    """The states of some joints (None: of all), of sensor_msgs/JointState messages as CDR bytes.

    Raises:
        InputError: as `Recording.joint_states`.
    """
    return decoding.joint_stream("joint_states", _batches("sensor_msgs/msg/JointState", messages), _ignore, names)


def _batches(message_type: str, messages: Sequence[bytes]) -> list[Batch]:
    sizes = np.array([len(message) for message in messages], dtype=np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]) if len(sizes) else sizes
    try:
        return list(decode(message_type, b"".join(messages), starts, sizes))
    except UndecodableError as error:
        raise InputError(
            ErrorCode.TYPE_MISMATCH, f"a message is not a {message_type} ({error}): check its publisher"
        ) from error


def _ignore(_topic: str, _late: int) -> None:
    """Late messages are counted when they arrive."""
