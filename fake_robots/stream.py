"""What a fake robot says: serialised messages in the order of time, from a bag or a simulated arm."""

import heapq
import struct
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple, Protocol

CLOCK = "/clock"  # the one absolute name: where ROS time is


class Message(NamedTuple):
    """One message: when it is due (ns, on the stream's own clock), on which topic, in CDR."""

    time: int
    topic: str
    data: bytes


class TopicInfo(NamedTuple):
    """How a topic is published: its type, and whether late subscribers get what was said before they came."""

    type: str
    latched: bool = False
    depth: int = 1000


class Source(Protocol):
    """Where messages come from."""

    @property
    def topics(self) -> Mapping[str, TopicInfo]:
        """All topics that it may speak on, by relative name."""

    def messages(self) -> Iterator[Message]:
        """All messages in the order of time, from the beginning."""


def with_clock(messages: Iterable[Message], rate: float) -> Iterator[Message]:
    """The messages, with ticks of `/clock` at `rate` Hz between them, the first one before the first message."""
    period = max(round(1e9 / rate), 1)
    tick: int | None = None
    for message in messages:
        if tick is None or message.time < tick - period:
            tick = message.time
        while tick <= message.time:
            yield Message(tick, CLOCK, clock_bytes(tick))
            tick += period
        yield message


def clock_bytes(time: int) -> bytes:
    """CDR of rosgraph_msgs/Clock."""
    seconds, nanoseconds = divmod(time, 10**9)
    return b"\x00\x01\x00\x00" + struct.pack("<iI", seconds, nanoseconds)


def in_order(*streams: Iterable[Message]) -> Iterator[Message]:
    """Several streams in the order of time, read no further than needed."""
    return heapq.merge(*streams, key=lambda message: message.time)
