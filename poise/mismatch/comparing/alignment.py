"""When a robot was at the same place of the same motion in two recordings: other start, rate, clock, pauses.

A local alignment of the postures (Smith and Waterman 1981, with postures for letters) finds the common part; its times
are then refined by Gauss-Newton steps along the motion.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from poise.errors import ErrorCode, InputError
from poise.mismatch.recorded import EffortTrack, RecordedMotion, linear_at
from poise.types import Array, Mask

_STEP, _MOST = 0.05, 1500
"""s between the postures that are matched, and how many of each recording, at the most."""
_NEAR = 0.06
"""Share of the spread of the motion within which postures are like each other."""
_STRAY = 0.01
"""Cost of a step in one recording alone, so that times run at one rate where the robot rests."""
_FINE, _WINDOW, _REFINEMENTS = 0.02, 0.3, 20
"""s between refined times, s of smoothing, and steps of the refinement."""
_ALIKE = 0.55
"""Likeness of two names from which they may be those of one joint."""
_MOVING = 0.02
"""rad/s or m/s from which a recording moves."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """Times of one motion in two recordings.

    Args:
        seconds: (K,) s of this recording, ascending.
        other: (K,) s of the other recording at the same place of the motion.
        distance: (K,) rad or m between both postures at these times.
        slip: (K,) rad/s or m/s, the difference of both velocities there.
        moving: (K,) whether both move there.
        share: of this recording's motion that the other has too.
    """

    seconds: Array
    other: Array
    distance: Array
    slip: Array
    moving: Mask
    share: float

    @property
    def rate(self) -> float:
        """This one's speed over the other's, in the middle; NaN when nothing moves."""
        slopes = np.gradient(self.other, self.seconds)[self.moving] if len(self.seconds) > 1 else np.zeros(0)
        return float(np.median(slopes)) if len(slopes) else np.nan

    def reversed(self) -> "Alignment":
        """The other recording's alignment with this one; `share` stays that of this one."""
        at = np.arange(self.other[0], self.other[-1], _FINE)
        times, distance, slip, moving = (
            np.interp(at, self.other, part) for part in (self.seconds, self.distance, self.slip, self.moving)
        )
        return Alignment(at, times, distance, slip, moving > 0.5, self.share)

    def alike(self, distance: float, slip: float, margin: float) -> Mask:
        """(K,) times at which postures and velocities differ by less, for `margin` s before and after."""
        off = (self.distance > distance) | (self.slip > slip)
        width = 1 + 2 * round(margin / (self.seconds[1] - self.seconds[0])) if len(off) > 1 else 1
        return ~np.asarray(maximum_filter1d(off, width))

    def at(self, seconds: Array) -> Array:
        """(N,) s of the other recording at some s (N,) of this one; NaN outside the common part."""
        if not len(self.seconds):
            return np.full(len(seconds), np.nan)
        return np.interp(seconds, self.seconds, self.other, left=np.nan, right=np.nan)


def postures(recorded: RecordedMotion) -> tuple[tuple[str, ...], Array, Array]:
    """Names of the joints, s (N,) and their positions (N, J); the place of a base that moves is added.

    Raises:
        InputError: UNSUPPORTED without joint states.
    """
    track = recorded.joints if recorded.joints is not None else recorded.effort
    if track is None:
        raise InputError(
            ErrorCode.UNSUPPORTED, "compare: motions are matched by joint_states, and a recording has none"
        )
    seconds = track.seconds if isinstance(track, EffortTrack) else recorded.seconds
    if recorded.base is None or recorded.joints is None:
        return track.names, seconds, track.position
    place = recorded.base.position_in_world[:, :2]
    return (*track.names, "base x", "base y"), seconds, np.hstack([track.position, place - place[0]])


def align(this: RecordedMotion, other: RecordedMotion) -> Alignment:
    """Match the motion of two recordings.

    Raises:
        InputError: UNSUPPORTED without joint states; BAD_INPUT when the joints differ.
    """
    (names, seconds, places), (other_names, other_seconds, other_places) = postures(this), postures(other)
    if names != other_names:
        raise other_joints(names, other_names)
    step = max(_STEP, (max(seconds[-1] - seconds[0], other_seconds[-1] - other_seconds[0])) / _MOST)
    coarse, rough = (np.arange(part[0], part[-1], step) for part in (seconds, other_seconds))
    found = _local(linear_at(seconds, places, coarse), linear_at(other_seconds, other_places, rough))
    if len(found) < 2:
        nothing = np.zeros(0)
        return Alignment(nothing, nothing, nothing, nothing, nothing.astype(bool), 0.0)
    rows, columns = found.T
    first, count = np.unique(rows, return_counts=True)
    times = np.bincount(rows - rows[0], rough[columns])[first - rows[0]] / count
    fine = np.arange(coarse[first[0]], coarse[first[-1]] + 1e-9, _FINE)
    return _refined(fine, np.interp(fine, coarse[first], times), (seconds, places), (other_seconds, other_places))


def other_joints(names: tuple[str, ...], other_names: tuple[str, ...]) -> InputError:
    """The joints that only one recording has, with those that look alike."""
    more = [name for name in names if name not in other_names]
    lack = [name for name in other_names if name not in names]
    there = f"the second alone has {', '.join(more) or 'none'}, the first alone {', '.join(lack) or 'none'}"
    pairs = look_alikes(more, lack)
    advice = "these are recordings of two robots"
    if not more and not lack:
        there, advice = "they are in another order", "give one robot_description for both"
    elif pairs:
        alike = ", ".join(f"{own}={other}" for own, other in pairs)
        advice = (
            f"these look alike: {alike}; if they are the same joints, say so with --joints {alike.replace(' ', '')}"
        )
    return InputError(ErrorCode.BAD_INPUT, f"compare: the joints of the recordings differ: {there}; {advice}")


def look_alikes(names: Sequence[str], others: Sequence[str]) -> list[tuple[str, str]]:
    """Pairs of names that differ by little, or by a prefix, the most alike first; each name once."""
    prefixes = [_common_start(each) for each in (names, others)]
    ranked = sorted(
        (
            (max(_likeness(name, other), _likeness(name[prefixes[0] :], other[prefixes[1] :])), name, other)
            for name in names
            for other in others
        ),
        reverse=True,
    )
    found: list[tuple[str, str]] = []
    for size, name, other in ranked:
        if size > _ALIKE and all(name != one and other != two for one, two in found):
            found.append((name, other))
    return sorted(found, key=lambda pair: names.index(pair[0]))


def _common_start(names: Sequence[str]) -> int:
    """Letters that all of several names begin with."""
    first, last = min(names, default=""), max(names, default="")
    return next((at for at, (one, two) in enumerate(zip(first, last, strict=False)) if one != two), 0)


def _likeness(name: str, other: str) -> float:
    """0 to 1; numbers count: joint_1 is not like joint_2."""
    one, two = (re.sub(r"[^a-z0-9]", "", each.lower().replace("joint", "j")) for each in (name, other))
    numbers = [re.sub(r"[^0-9]", "", each)[-1:] for each in (one, two)]
    return SequenceMatcher(None, one, two).ratio() * (1.0 if numbers[0] == numbers[1] else 0.5)


def _local(this: Array, other: Array) -> NDArray[np.intp]:
    """(P, 2) indices of the best local alignment of postures (N, J) and (M, J), by anti-diagonals."""
    spread = np.sqrt(np.concatenate([this, other]).var(axis=0).sum())
    scale = max(_NEAR * spread, 1e-3)
    square = np.maximum((this**2).sum(1)[:, None] + (other**2).sum(1) - 2 * this @ other.T, 0.0)
    gain = np.maximum(1.0 - square / scale**2, -20.0)
    rows, columns = gain.shape
    score, move = np.zeros((rows + 1, columns + 1)), np.zeros((rows + 1, columns + 1), np.uint8)
    for total in range(2, rows + columns + 1):
        i = np.arange(max(1, total - columns), min(rows, total - 1) + 1)
        j = total - i
        here = gain[i - 1, j - 1]
        alone = np.minimum(here, 0.0) - _STRAY
        ways = np.stack(
            [np.zeros(len(i)), score[i - 1, j - 1] + here, score[i - 1, j] + alone, score[i, j - 1] + alone]
        )
        move[i, j] = np.argmax(ways, axis=0)
        score[i, j] = ways.max(axis=0)
    end = np.unravel_index(np.argmax(score), score.shape)
    row, column = int(end[0]), int(end[1])
    path = []
    while move[row, column]:
        path.append((row - 1, column - 1))
        way = move[row, column]
        row, column = row - int(way != 3), column - int(way != 2)
    return np.array(path[::-1], dtype=np.intp).reshape(-1, 2)


def _refined(at: Array, times: Array, this: tuple[Array, Array], other: tuple[Array, Array]) -> Alignment:
    """Times (K,) of the other recording, moved along its motion to where the postures are nearest."""
    place = linear_at(*this, at)
    velocity = np.gradient(place, at, axis=0)
    width = _WINDOW / (at[1] - at[0])
    rates = np.gradient(other[1], other[0], axis=0)
    even = np.linspace(times[0], times[-1], len(times))
    times = np.maximum.accumulate(even + gaussian_filter1d(times - even, width))  # the steps of the path are coarse
    for _ in range(_REFINEMENTS):
        rate = linear_at(other[0], rates, times)
        off = place - linear_at(*other, times)
        along = gaussian_filter1d((rate * off).sum(axis=1), width)
        size = gaussian_filter1d((rate**2).sum(axis=1), width)
        step = np.clip(along / (size + _MOVING**2), -0.2, 0.2)
        times = np.maximum.accumulate(np.clip(times + step, other[0][0], other[0][-1]))
    distance = np.linalg.norm(place - linear_at(*other, times), axis=1)
    others = linear_at(other[0], rates, times)
    slip = np.linalg.norm(velocity - others, axis=1)
    moving = (np.linalg.norm(velocity, axis=1) > _MOVING) & (np.linalg.norm(others, axis=1) > _MOVING)
    whole = np.arange(this[0][0], this[0][-1], at[1] - at[0])
    moves = np.linalg.norm(np.gradient(linear_at(*this, whole), whole, axis=0), axis=1) > _MOVING
    return Alignment(at, times, distance, slip, moving, float(moving.sum() / max(moves.sum(), 1)))
