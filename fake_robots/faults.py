"""Faults on purpose: what networks, drivers and clocks do to messages. Each wraps a stream; they can be stacked."""

import dataclasses
import functools
import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import yaml

from poise.errors import ErrorCode, InputError
from poise.fake_robots.stream import CLOCK, Message
from poise.recording import typestore

_NANO = 1_000_000_000
Types = Mapping[str, str]


@dataclass(frozen=True)
class Fault:
    """Where and when a fault strikes.

    Args:
        topic: relative name; empty: every topic.
        start, end: s after the first message, half open.
        share: probability that a message in there is hit.
    """

    topic: str = ""
    start: float = 0.0
    end: float = float("inf")
    share: float = 1.0

    def apply(self, messages: Iterable[Message], types: Types, rng: np.random.Generator) -> Iterator[Message]:
        """The messages with the fault."""
        raise NotImplementedError

    def _struck(self, messages: Iterable[Message], rng: np.random.Generator) -> Iterator[tuple[Message, bool]]:
        first: int | None = None
        for message in messages:
            first = message.time if first is None else first
            seconds = (message.time - first) / _NANO
            here = (message.topic == self.topic or not self.topic) and self.start <= seconds < self.end
            yield message, here and (self.share >= 1.0 or rng.random() < self.share)


@dataclass(frozen=True)
class Drop(Fault):
    """Messages that are lost; with share 1 a topic falls silent."""

    def apply(self, messages: Iterable[Message], types: Types, rng: np.random.Generator) -> Iterator[Message]:
        """The messages that arrive."""
        return (message for message, hit in self._struck(messages, rng) if not hit)


@dataclass(frozen=True)
class Delay(Fault):
    """Messages that come later than they should; header stamps stay.

    Args:
        seconds: by how much.
        jitter: up to this much more, evenly spread; it can put messages out of order.
    """

    seconds: float = 0.0
    jitter: float = 0.0

    def apply(self, messages: Iterable[Message], types: Types, rng: np.random.Generator) -> Iterator[Message]:
        """The messages by their time of arrival."""
        waiting: list[tuple[int, int, Message]] = []
        for count, (message, hit) in enumerate(self._struck(messages, rng)):
            late = round((self.seconds + self.jitter * rng.random()) * _NANO) if hit else 0
            heapq.heappush(waiting, (message.time + late, count, message._replace(time=message.time + late)))
            while waiting and waiting[0][0] <= message.time:
                yield heapq.heappop(waiting)[2]
        while waiting:
            yield heapq.heappop(waiting)[2]


@dataclass(frozen=True)
class Reorder(Fault):
    """Messages that are overtaken by the next `depth` ones of their topic."""

    depth: int = 1

    def apply(self, messages: Iterable[Message], types: Types, rng: np.random.Generator) -> Iterator[Message]:
        """The messages as they overtake each other."""
        held: list[list[Any]] = []  # [message, how many may still pass it]
        for message, hit in self._struck(messages, rng):
            if hit and all(entry[0].topic != message.topic for entry in held):
                held.append([message, self.depth])
                continue
            yield message
            for entry in held:
                entry[1] -= entry[0].topic == message.topic
            for entry in [entry for entry in held if entry[1] <= 0]:
                held.remove(entry)
                yield entry[0]._replace(time=message.time)
        for entry in held:
            yield entry[0]


@dataclass(frozen=True)
class Edit(Fault):
    """A fault that changes what messages say."""

    def apply(self, messages: Iterable[Message], types: Types, rng: np.random.Generator) -> Iterator[Message]:
        """The messages as they read now."""
        for message, hit in self._struck(messages, rng):
            type_name = types.get(message.topic, "")
            if not hit or not self._concerns(message, type_name):
                yield message
                continue
            changed = self.edit(typestore().deserialize_cdr(message.data, type_name))
            yield message._replace(data=bytes(typestore().serialize_cdr(changed, type_name)))

    def edit(self, content: Any) -> Any:
        """The changed content of a message."""
        raise NotImplementedError

    def _concerns(self, message: Message, type_name: str) -> bool:
        return type_name in typestore().types and message.topic != CLOCK


@dataclass(frozen=True)
class NotANumber(Edit):
    """Every number of a message (but its stamp) becomes NaN."""

    def edit(self, content: Any) -> Any:
        """All NaN."""
        return _mapped(content, lambda value: value * np.nan)


@dataclass(frozen=True)
class Saturate(Edit):
    """A wrench that stops at the sensor's range.

    Args:
        force: N.
        torque: N m.
    """

    force: float = 100.0
    torque: float = 10.0

    def edit(self, content: Any) -> Any:
        """Clipped."""

        def clip(limit: float) -> Callable[[Any], Any]:
            return lambda value: min(max(value, -limit), limit)

        wrench = dataclasses.replace(
            content.wrench,
            force=_mapped(content.wrench.force, clip(self.force)),
            torque=_mapped(content.wrench.torque, clip(self.torque)),
        )
        return dataclasses.replace(content, wrench=wrench)

    def _concerns(self, message: Message, type_name: str) -> bool:
        return type_name == "geometry_msgs/msg/WrenchStamped"


@dataclass(frozen=True)
class TimeJump(Edit):
    """A clock that is set: every stamp, `/clock` too, jumps by `seconds` from `start` on."""

    seconds: float = field(default=0.0)

    def edit(self, content: Any) -> Any:
        """With other stamps."""
        return _shifted(content, round(self.seconds * _NANO))

    def _concerns(self, message: Message, type_name: str) -> bool:
        return type_name in typestore().types


_FAULTS: dict[str, type[Fault]] = {
    "drop": Drop,
    "delay": Delay,
    "nan": NotANumber,
    "saturate": Saturate,
    "reorder": Reorder,
    "time_jump": TimeJump,
}


def parse_faults(lines: Sequence[str]) -> list[Fault]:
    """Read faults as a parameter gives them, one a line: "drop: {topic: wrench, share: 0.1, start: 2, end: 5}".

    Raises:
        InputError: BAD_INPUT with the line and what is wrong with it.
    """
    return [_parse(line) for line in lines if line.strip()]


def apply_faults(messages: Iterator[Message], faults: Sequence[Fault], types: Types, seed: int) -> Iterator[Message]:
    """Stack the faults, the first innermost; the same seed strikes the same messages."""
    rngs = np.random.default_rng(seed).spawn(len(faults))
    return functools.reduce(
        lambda stream, pair: pair[0].apply(stream, types, pair[1]), zip(faults, rngs, strict=True), messages
    )


def _parse(line: str) -> Fault:
    try:
        content = yaml.safe_load(line)
    except yaml.YAMLError as error:
        raise _bad(line, f"it is not YAML ({' '.join(str(error).split())})") from error
    content = {content: {}} if isinstance(content, str) else content
    if not isinstance(content, dict) or len(content) != 1 or next(iter(content)) not in _FAULTS:
        raise _bad(line, f"expected one of {', '.join(_FAULTS)}")
    kind, options = next(iter(content.items()))
    options = {} if options is None else options
    known = {entry.name: entry.type for entry in dataclasses.fields(_FAULTS[kind])}
    if not isinstance(options, dict) or not set(options) <= set(known):
        raise _bad(line, f"{kind} takes {', '.join(known)}")
    values: dict[str, Any] = {}
    for name, value in options.items():
        if name == "topic":
            values[name] = str(value).strip("/") if value != CLOCK else CLOCK
        elif isinstance(value, bool) or not isinstance(value, int | float) or np.isnan(value):
            raise _bad(line, f"{name} must be a number")
        elif value < 0 and kind != "time_jump":
            raise _bad(line, f"{name} must not be negative")
        else:
            values[name] = int(value) if name == "depth" else float(value)
    return _FAULTS[kind](**values)


def _bad(line: str, reason: str) -> InputError:
    return InputError(ErrorCode.BAD_INPUT, f"fault '{line}': {reason}")


def _parts(content: Any) -> dict[str, Any]:
    return {part.name: getattr(content, part.name) for part in dataclasses.fields(content) if part.name[0] != "_"}


def _mapped(content: Any, function: Callable[[Any], Any]) -> Any:
    """The content with every floating-point number changed, headers left alone."""
    if isinstance(content, float) or (isinstance(content, np.ndarray) and content.dtype.kind == "f"):
        return function(content)
    if isinstance(content, list):
        return [_mapped(entry, function) for entry in content]
    if _type_of(content) in ("", "std_msgs/msg/Header"):
        return content
    return dataclasses.replace(content, **{name: _mapped(part, function) for name, part in _parts(content).items()})


def _shifted(content: Any, nanoseconds: int) -> Any:
    """The content with every time in it moved, not before zero."""
    if isinstance(content, list):
        return [_shifted(entry, nanoseconds) for entry in content]
    if not _type_of(content):
        return content
    parts = _parts(content)
    if _type_of(content) == "builtin_interfaces/msg/Time":
        seconds, rest = divmod(max(parts["sec"] * _NANO + parts["nanosec"] + nanoseconds, 0), _NANO)
        return dataclasses.replace(content, sec=seconds, nanosec=rest)
    return dataclasses.replace(content, **{name: _shifted(part, nanoseconds) for name, part in parts.items()})


def _type_of(content: Any) -> str:
    """The type of a (nested) message; empty for anything else."""
    return str(getattr(content, "__msgtype__", ""))
