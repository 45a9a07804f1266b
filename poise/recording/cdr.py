"""Decoding CDR, the wire format of ROS 2 messages, many messages at once.

Messages of one topic mostly have the same layout: the same frame names, the same number of joints. The layout is
found by walking one message; all others whose lengths and texts are the same bytes are then read as columns.

Source: OMG formal/02-06-51 (CDR), chapter 15.3; the encapsulation header is that of DDS-RTPS, chapter 10.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from poise.types import Indices

STAMP, STRING, STRINGS, FLOATS = "stamp", "string", "strings", "floats"
Kind = str | int  # a number: so many float64
Spec = tuple[tuple[str, Kind], ...]
_HEADER: Spec = (("stamp", STAMP), ("frame_id", STRING))
_POSE: Spec = (("translation", 3), ("rotation", 4))
_SPECS: dict[str, Spec] = {
    "geometry_msgs/msg/WrenchStamped": (*_HEADER, ("wrench", 6)),
    "sensor_msgs/msg/JointState": (
        *_HEADER,
        ("names", STRINGS),
        ("position", FLOATS),
        ("velocity", FLOATS),
        ("effort", FLOATS),
    ),
    "sensor_msgs/msg/Imu": (
        *_HEADER,
        ("orientation", 4),
        ("orientation_covariance", 9),
        ("angular_velocity", 3),
        ("angular_velocity_covariance", 9),
        ("linear_acceleration", 3),
        ("linear_acceleration_covariance", 9),
    ),
    "nav_msgs/msg/Odometry": (
        *_HEADER,
        ("child_frame_id", STRING),
        *_POSE,
        ("pose_covariance", 36),
        ("twist", 6),
        ("twist_covariance", 36),
    ),
    "tf2_msgs/msg/TFMessage": (*_HEADER, ("child_frame_id", STRING), *_POSE),
    "std_msgs/msg/String": (("data", STRING),),
}
_LISTS = {"tf2_msgs/msg/TFMessage"}  # a sequence of what the table says

_ENCAPSULATION = 4  # bytes in front, not counted by the alignment
_PADDING = 16  # bytes behind the content: rclpy.serialization adds up to 12, its estimate for empty sequences
_MOST_LAYOUTS = 32  # after so many layouts of a topic, go message by message


class UndecodableError(ValueError):
    """A message whose bytes are not of its type.

    Args:
        index: which of the messages.
    """

    def __init__(self, index: int, why: str) -> None:
        super().__init__(why)
        self.index = index


@dataclass(frozen=True, eq=False)
class Batch:
    """Messages that were decoded together.

    Args:
        index: (K,) which of the messages, rising.
        elements: one for each element of a list message, else one: stamps (K,) int64 ns, numbers (K, count) float64,
            and texts that all K messages share.
    """

    index: npt.NDArray[np.int64]
    elements: list[dict[str, Any]]


@dataclass
class MessageLayout:
    """Where everything is in a message, as found by walking it."""

    order: str
    numbers: list[dict[str, tuple[str, int, int]]] = field(default_factory=list)  # name: (kind, offset, count)
    texts: list[dict[str, Any]] = field(default_factory=list)
    fixed: list[int] = field(default_factory=list)  # bytes that must be the same for the layout to hold


def decode(message_type: str, data: bytes, starts: Indices, sizes: Indices) -> Iterator[Batch]:
    """Decode the messages of this type that lie at these places.

    Args:
        message_type: one of _SPECS.
        data: bytes that hold them.
        starts: (M,) offset of each message, at its encapsulation header.
        sizes: (M,) bytes of each.

    Raises:
        UndecodableError: a message does not have this type.
    """
    pending = np.arange(len(starts))
    for _ in range(_MOST_LAYOUTS):
        if not len(pending):
            return
        alike = sizes[pending] == sizes[pending[0]]
        batch = _decode_first(message_type, data, starts, sizes, pending[alike])
        yield batch
        if len(batch.index) == len(pending):
            return
        pending = np.setdiff1d(pending, batch.index, assume_unique=True)
    for index in pending:
        yield _decode_first(message_type, data, starts, sizes, np.array([index]))


def _decode_first(
    message_type: str, data: bytes, starts: Indices, sizes: Indices, candidates: npt.NDArray[np.int64]
) -> Batch:
    """Decode the first of some messages of one size, and all of them that have its layout."""
    first = int(candidates[0])
    start, size = int(starts[first]), int(sizes[first])
    try:
        layout = layout_of(message_type, data[start : start + size])
    except (struct.error, UnicodeDecodeError, ValueError) as error:
        raise UndecodableError(first, str(error)) from error
    # An item of `size` bytes at every offset: a message is copied as one item.
    items: npt.NDArray[np.void] = np.ndarray(len(data) - size + 1, dtype=f"V{size}", buffer=data, strides=(1,))
    rows = items[starts[candidates]].view(np.uint8).reshape(-1, size)
    same = (rows[:, layout.fixed] == rows[0, layout.fixed]).all(axis=1)
    return Batch(candidates[same], _columns(layout, rows[same]))


def _columns(layout: MessageLayout, rows: npt.NDArray[np.uint8]) -> list[dict[str, Any]]:
    """Read the columns of a layout from (K, size) bytes."""
    elements = []
    for numbers, texts in zip(layout.numbers, layout.texts, strict=True):
        element = dict(texts)
        for name, (kind, offset, count) in numbers.items():
            if kind == STAMP:
                seconds = _column(rows, offset, 4, layout.order + "i4")[:, 0].astype(np.int64)
                element[name] = seconds * 1_000_000_000 + _column(rows, offset + 4, 4, layout.order + "u4")[:, 0]
            else:
                element[name] = _column(rows, offset, 8 * count, layout.order + "f8").astype(np.float64)
        elements.append(element)
    return elements


def _column(rows: npt.NDArray[np.uint8], offset: int, size: int, dtype: str) -> npt.NDArray[Any]:
    return np.ascontiguousarray(rows[:, offset : offset + size]).view(dtype)


def layout_of(message_type: str, sample: bytes) -> MessageLayout:
    """Find the layout of one message."""
    if len(sample) < _ENCAPSULATION or sample[0] != 0 or sample[1] not in (0, 1):
        raise ValueError(f"its encapsulation {sample[:2].hex()} is not plain CDR")
    layout = MessageLayout("<" if sample[1] else ">", fixed=[0, 1])
    walker = _Walker(sample, layout)
    count = walker.length() if message_type in _LISTS else 1
    for _ in range(count):
        walker.element(_SPECS[message_type])
    if not 0 <= len(sample) - walker.position <= _PADDING:
        raise ValueError(f"it has {len(sample)} bytes, its content {walker.position}")
    return layout


class _Walker:
    """A walk through one message, from field to field."""

    def __init__(self, sample: bytes, layout: MessageLayout) -> None:
        self.sample, self.layout, self.position = sample, layout, _ENCAPSULATION

    def element(self, spec: Spec) -> None:
        numbers: dict[str, tuple[str, int, int]] = {}
        texts: dict[str, Any] = {}
        for name, kind in spec:
            if kind == STAMP:
                numbers[name] = (STAMP, self.skip(4, 8), 1)
            elif kind == STRING:
                texts[name] = self.text()
            elif kind == STRINGS:
                texts[name] = tuple(self.text() for _ in range(self.length()))
            else:
                count = self.length() if kind == FLOATS else int(kind)
                # an empty sequence has no elements to align
                numbers[name] = (FLOATS, self.skip(8, 8 * count) if count else self.position, count)
        self.layout.numbers.append(numbers)
        self.layout.texts.append(texts)

    def skip(self, alignment: int, size: int) -> int:
        """Pass over a field and return where it starts."""
        start = self.position + (_ENCAPSULATION - self.position) % alignment
        self.position = start + size
        if self.position > len(self.sample):
            raise ValueError(f"it ends after {len(self.sample)} bytes in the middle of a field")
        return start

    def length(self) -> int:
        start = self.skip(4, 4)
        self.layout.fixed += range(start, start + 4)
        (count,) = struct.unpack_from(self.layout.order + "I", self.sample, start)
        if count > len(self.sample):  # no element is smaller than a byte
            raise ValueError(f"it claims {count} elements in {len(self.sample)} bytes")
        return int(count)

    def text(self) -> str:
        size = self.length()
        start = self.skip(1, size)
        self.layout.fixed += range(start, start + size)
        return self.sample[start : start + size].rstrip(b"\0").decode()
