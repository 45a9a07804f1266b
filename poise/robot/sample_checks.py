"""Samples of a stream that are no measurements of their own: repeated stamps, single jumps, interpolation."""

from typing import TypeVar

import numpy as np

from poise.geometry import runs
from poise.recording import Stream
from poise.types import Array, Mask

Sampled = TypeVar("Sampled", bound=Stream)

_FAR, _LEAST = 10.0, 0.01
"""A sample stands alone where it is farther from both neighbours than these are from each other and than the usual
motion over two samples, by this factor, and than so much in rad or m."""
_DIGITS, _STAMP = 1e-6, 1e-6
"""Rounding of values, as a share of the largest, and of stamps in s, in a text table."""
_BETWEEN, _UNCLEAR, _CORNERS, _CLEAR = 0.2, 0.05, 0.05, 10.0
"""Least share of interpolated samples; largest share of those off the line by more than the rounding, but by less than
so many times of it, since smooth motions have all sizes; least share of the corners beyond."""

_LOOK = 20_000
"""Samples of the beginning, which show whether a stream is interpolated."""

_LONGEST, _FEWEST = 5, 3
"""Samples in a row that are blank at most, and how often; longer ones may be a robot at home or a sensor at zero."""
_JUMP = 3.0
"""Ratio of the steps to zero and back to the largest other step from which no joint makes them."""


def each_stamp_once(stream: Sampled) -> Sampled:
    """The first sample of each stamp."""
    return stream.select(np.diff(stream.stamps, prepend=np.iinfo(np.int64).min // 2) > 0)


def left_out(stream: Sampled, rows: Mask, what: str) -> tuple[Sampled, list[str]]:
    """The stream without some samples (N,), and a note that says what they are; none where there are none."""
    if not rows.any():
        return stream, []
    return stream.select(~rows), [f"{int(rows.sum())} {what} and were left out"]


def stands_alone(position: Array, turning: Mask) -> Mask:
    """(N,) positions (N, J) that are far from the ones before and after, which are near each other.

    Args:
        position: (N, J) rad or m.
        turning: (J,) coordinates whose whole turns are no distance: at half a turn, either end may be reported.
    """
    found = np.zeros(len(position), dtype=bool)
    if len(position) < 3:
        return found

    def distance(apart: int) -> Array:
        change = position[apart:] - position[:-apart]
        short = np.where(turning, np.remainder(change + np.pi, 2.0 * np.pi) - np.pi, change)
        return np.asarray(np.abs(short).max(axis=1))

    step, across = distance(1), distance(2)
    found[1:-1] = np.minimum(step[:-1], step[1:]) > _FAR * np.maximum(across, np.median(across)) + _LEAST
    return found


def blanks(values: Array) -> Mask:
    """(N,) samples that are exactly zero in all channels (N, C), between others that are far from zero.

    Some programs write zeros where a topic has no sample.
    """
    zero = np.asarray((values == 0.0).all(axis=1))
    others = values[~zero]
    if not zero.any() or len(others) < 2:
        return np.zeros(len(values), dtype=bool)
    size, step = np.abs(others).max(axis=1), np.abs(np.diff(others, axis=0)).max(axis=1)
    spans = runs(zero)
    long = [(first, last) for first, last in spans if last - first >= _LONGEST]
    if len(spans) - len(long) < _FEWEST or np.median(size) < _FAR * np.median(step):
        return np.zeros(len(values), dtype=bool)
    for first, last in long:
        zero[first : last + 1] = False
    return zero


def lapsed(position: Array) -> Mask:
    """(N,) samples at exactly zero in all joints (N, J), that the joints jump to and jump away from.

    A joint moves to its zero and away from it by steps as large as its others: no robot at home does this.
    """
    zero = np.asarray((position == 0.0).all(axis=1))
    if not zero.any():
        return zero
    steps = np.abs(np.diff(position, axis=0)).max(axis=1)
    least = _JUMP * float(steps[~(zero[1:] | zero[:-1])].max(initial=0.0)) + _LEAST
    for first, last in runs(zero):
        inner = first > 0 and last + 1 < len(position)
        zero[first : last + 1] = inner and float(np.abs(position[[first - 1, last + 1]]).max(axis=1).min()) > least
    return zero


def interpolated(stream: Stream, values: Array, fewest: int = 3) -> Mask:
    """(N,) samples on the straight line between their neighbours, of a stream in which this is no accident.

    Programs that merge topics of several rates into one table fill them so. Such samples repeat others, and their
    noise is not independent.

    Args:
        stream: N samples.
        values: (N, C) of them.
        fewest: channels that must change at once: a single coarse reading often lies on a line.
    """
    none = np.zeros(len(stream), dtype=bool)
    if len(stream) < 3 or values.shape[1] < fewest:
        return none
    begin = slice(0, _LOOK)
    if len(stream) > _LOOK and not interpolated(stream.select(begin), values[begin], fewest).any():
        return none
    seconds = stream.seconds
    span, change = (seconds[2:] - seconds[:-2])[:, None], values[2:] - values[:-2]
    line = values[:-2] + (seconds[1:-1] - seconds[:-2])[:, None] / span * change
    rounding = _DIGITS * np.abs(values).max(axis=0) + _STAMP * np.abs(change / span)
    off = (np.abs(values[1:-1] - line) / np.maximum(rounding, 1e-15)).max(axis=1)
    moving = np.count_nonzero(change, axis=1) >= fewest
    if not moving.any():
        return none
    on, clear = off[moving] <= 1.0, off[moving] > _CLEAR
    if on.mean() < _BETWEEN or clear.mean() < _CORNERS or (~on & ~clear).mean() > _UNCLEAR:
        return none
    none[1:-1] = moving & (off <= 1.0)
    return none
