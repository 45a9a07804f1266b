"""Encoding many samples of a stream at once: one message is the pattern, stamps and numbers are replaced row by row."""

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from poise.recording.cdr import STAMP, layout_of
from poise.recording.encoding import encode_stream, message_type_of, quaternions_of
from poise.recording.streams import ImuStream, JointStream, PoseStream, Stream, WrenchStream
from poise.types import Array, Stamps

Rows = npt.NDArray[np.uint8]


def pattern_of(topic: str, stream: Stream) -> bytes:
    """The CDR of one message that holds every quantity that any sample has.

    Args:
        topic: poses are odometry on `odom`, else tf.
        stream: at least one sample.
    """
    filled: dict[str, Any] = {}
    for name, values in stream.arrays().items():
        if name != "stamps" and (isinstance(stream, WrenchStream) or not np.isnan(values).all()):
            filled[name] = np.zeros_like(values[:1])
    if isinstance(stream, PoseStream):
        filled["rotation_parent_child"] = np.eye(3)[None]
    ((_, message),) = encode_stream(topic, replace(stream.select(slice(1)), **filled))
    return message


def encode_rows(topic: str, stream: Stream, stamps: Stamps) -> Rows:
    """(N, size) the CDR of every sample.

    A quantity that no sample has is left out of the messages, as `encode_stream` does; a single missing value is NaN.

    Args:
        topic: as in `pattern_of`.
        stream: at least one sample.
        stamps: (N,) ns, instead of those of the stream; in any order.
    """
    pattern = pattern_of(topic, stream)
    layout = layout_of(message_type_of(topic, stream), pattern)
    columns = _columns(stream)
    rows = np.tile(np.frombuffer(pattern, dtype=np.uint8), (len(stream), 1))
    for name, (kind, offset, count) in layout.numbers[0].items():
        if kind == STAMP:
            seconds, rest = np.divmod(stamps, 10**9)
            _put(rows, offset, seconds[:, None].astype("<i4"))
            _put(rows, offset + 4, rest[:, None].astype("<u4"))
        elif count and name in columns:
            _put(rows, offset, columns[name].astype("<f8"))
    return rows


def _columns(stream: Stream) -> dict[str, Array]:
    """(N, K) numbers by their names in the message layouts of `cdr.py`."""
    if isinstance(stream, WrenchStream):
        return {"wrench": stream.wrench_in_sensor}
    if isinstance(stream, JointStream):
        return {"position": stream.position, "velocity": stream.velocity, "effort": stream.effort}
    if isinstance(stream, PoseStream):
        rates = {} if stream.twist_in_child is None else {"twist": stream.twist_in_child}
        return {"translation": stream.translation_parent_child, "rotation": np.array(quaternions_of(stream))} | rates
    if isinstance(stream, ImuStream):
        measured = {"angular_velocity": stream.angular_velocity, "linear_acceleration": stream.linear_acceleration}
        return {name: values for name, values in measured.items() if not np.isnan(values).all()}
    return {}


def _put(rows: Rows, offset: int, values: npt.NDArray[Any]) -> None:
    data = np.ascontiguousarray(values).view(np.uint8)
    rows[:, offset : offset + data.shape[1]] = data
