"""Several recordings as one, in sequence, with a break between them."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.recorded import RecordedMotion
from poise.types import Mask

RECORDING_GAP = 5.0
"""s between the last sample of a recording and the first of the next, on the joint clock."""


def joined(recordings: Sequence[RecordedMotion]) -> tuple[RecordedMotion, Mask]:
    """One recording, and (N,) the mask of the samples of the last part.

    Seconds count from the first recording's first sample. What only some recordings have (joints, effort, commands)
    is dropped.

    Raises:
        InputError: BAD_INPUT when the recordings' joints differ, or only some have a wrench.
    """
    if len(recordings) == 1:
        return recordings[0], np.zeros(len(recordings[0]), dtype=bool)
    if len({recorded.joints.names for recorded in recordings if recorded.joints is not None}) > 1:
        raise InputError(ErrorCode.BAD_INPUT, "the recordings are of different robots: their joints differ")
    recordings = with_common_efforts(recordings)
    if len({recorded.has("wrench") for recorded in recordings}) > 1:
        raise InputError(
            ErrorCode.BAD_INPUT, "only some of the recordings have a wrench: diagnose the others separately"
        )
    if len({recorded.commands.names for recorded in recordings if recorded.commands is not None}) > 1:
        recordings = [replace(recorded, commands=None) for recorded in recordings]
    moved = []
    for recorded, (begin, _) in zip(recordings, spans(recordings), strict=True):
        shift = begin - float(recorded.seconds[0])
        effort, commands = recorded.effort, recorded.commands
        moved.append(
            replace(
                recorded,
                seconds=recorded.seconds + shift,
                effort=None if effort is None else replace(effort, seconds=effort.seconds + shift),
                commands=None if commands is None else replace(commands, seconds=commands.seconds + shift),
            )
        )
    whole = replace(
        _stacked(moved),
        begins=tuple(begin for begin, _ in spans(recordings)[1:]),
        place_noise=max(recorded.place_noise for recorded in recordings),
    )
    last = np.arange(len(whole)) >= len(whole) - len(recordings[-1])
    return whole, last


def with_common_efforts(recordings: Sequence[RecordedMotion]) -> list[RecordedMotion]:
    """With the efforts of the joints that have a usable one in every recording."""
    tracks = [recorded.effort for recorded in recordings]
    common = set.intersection(*(set() if track is None else set(track.names) for track in tracks))
    cut = [
        None if track is None or not common else track.of_joints(np.array([name in common for name in track.names]))
        for track in tracks
    ]
    return [replace(recorded, effort=effort) for recorded, effort in zip(recordings, cut, strict=True)]


def spans(recordings: Sequence[RecordedMotion]) -> list[tuple[float, float]]:
    """(first, last) s of each recording on the clock of the joined recording; a single one is unchanged."""
    if len(recordings) == 1:
        return [(float(recordings[0].seconds[0]), float(recordings[0].seconds[-1]))]
    found, begin = [], 0.0
    for recorded in recordings:
        found.append((begin, begin + recorded.duration))
        begin += recorded.duration + RECORDING_GAP
    return found


def without(recorded: RecordedMotion, last: Mask) -> RecordedMotion:
    """The joined recording without its last part, joint efforts included.

    Args:
        recorded: of several parts.
        last: (N,) the samples of the last part.
    """
    kept, effort = recorded.select(~last), recorded.effort
    end = recorded.begins[-1]
    if effort is not None:
        effort = effort.select(effort.seconds < end)
    return replace(kept, effort=effort, begins=recorded.begins[:-1])


def _stacked(parts: Sequence[Any]) -> Any:
    """Dataclasses of one kind: arrays (N, ...) concatenated, tracks likewise, other fields as in the first."""
    first = parts[0]
    changes: dict[str, Any] = {}
    for field in fields(first):
        values = [getattr(part, field.name) for part in parts]
        if any(value is None for value in values):
            changes[field.name] = None
        elif isinstance(values[0], np.ndarray) and field.name != "phi":
            changes[field.name] = np.concatenate(values)
        elif hasattr(values[0], "__dataclass_fields__"):
            changes[field.name] = _stacked(values)
    return replace(first, **changes)
