"""Where two recordings of one motion differ, without any model: by channel, in time, and what it goes with."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import runs
from poise.mismatch.comparing.alignment import Alignment, align
from poise.mismatch.comparing.comparison import same_path, same_speed, without_common
from poise.mismatch.recorded import WRENCH_CHANNELS, EffortTrack, RecordedMotion
from poise.types import Array, Mask

_NOISE, _TOLERANCE = 0.3, 0.01
"""Sizes from which a channel differs: of the noise of the difference, and of the largest reading."""
_BLOCK, _STRETCH = 0.2, 0.5
"""s over which a difference is averaged, so that noise vanishes; and over which its size is."""
_DIRECTION = 0.02
"""rad/s or m/s: width in which the direction of motion changes."""
_PART, _COLUMN = 0.03, 0.01
"""Share of the square that a state must explain beyond the others, and that each of its columns costs: in one motion,
speeds and accelerations are functions of the posture."""


@dataclass(frozen=True)
class LocatedChannel:
    """One joint effort or wrench channel.

    Args:
        name, unit: of it.
        size: rms of the recording minus the other one, where both are at the same postures, without noise.
        noise: one sigma of the random part of the difference.
        reading: the largest of the recording's readings, without outliers.
        goes_with: states that explain a part of the square of the difference, with their shares, in their order.
        windows: (start, end) s of the recording in which it differs.
    """

    name: str
    unit: str
    size: float
    noise: float
    reading: float
    goes_with: tuple[tuple[str, float], ...]
    windows: tuple[tuple[float, float], ...]

    @property
    def differs(self) -> bool:
        """Whether the difference is more than noise and a small part of the reading."""
        return self.size > max(_NOISE * self.noise, _TOLERANCE * self.reading)

    @property
    def sentence(self) -> str:
        """For people."""
        parts = [f"{100 * share:.0f} % with {state}" for state, share in self.goes_with]
        rest = 1.0 - sum(share for _, share in self.goes_with)
        goes = ", ".join([*parts, f"{100 * rest:.0f} % with none"]) if parts else "with no state"
        times = self.size / max(self.noise, 1e-12)
        return f"{self.name} differs by {self.size:.3g} {self.unit} (rms), {times:.1f} times the noise; it goes {goes}."


@dataclass(frozen=True, eq=False)
class Located:
    """What differs: channels, and how the motions match."""

    channels: tuple[LocatedChannel, ...]
    alignment: Alignment

    @property
    def notes(self) -> tuple[str, ...]:
        """What qualifies the answer."""
        if same_speed(self.alignment):
            return ()
        fast = f"the recording moves {self.alignment.rate:.2f} times as fast as the simulation"
        return (f"{fast}: what depends on speed differs for that reason; simulate at the same speed, or give --model",)

    @property
    def differing(self) -> tuple[LocatedChannel, ...]:
        """The channels that differ, the largest in units of the noise first."""
        found = [each for each in self.channels if each.differs]
        return tuple(sorted(found, key=lambda each: -each.size / max(each.noise, 1e-12)))


def located(this: RecordedMotion, other: RecordedMotion) -> Located:
    """Where a recording differs from another one at the same postures, for example from a simulator's.

    Raises:
        InputError: as `align`; TOPIC_MISSING when they have no signal in common.
        NoAnswerError: NOT_IDENTIFIABLE when the motions differ: without a model, only the same motion can be compared.
    """
    matched = align(this, other)
    if not same_path(matched):
        raise NoAnswerError(
            ErrorCode.NOT_IDENTIFIABLE,
            f"only {matched.share:.0%} of the recording's motion is also in the simulator's: without a model of the"
            " robot the same motion must be simulated; play the recorded commands, or give --model",
        )
    less = without_common(this, other, matched)
    channels: list[LocatedChannel] = []
    if less.effort is not None and this.effort is not None:
        track = less.effort
        readings = this.effort.sizes.tolist()
        for j, name in enumerate(track.names):
            states = _joint_states(track, j)
            channels.append(
                _channel(name, track.unit("N m", name), track.seconds, track.measured[:, j], readings[j], states)
            )
    if less.has("wrench"):
        sizes = np.quantile(np.abs(this.wrench), 0.99, axis=0)
        whole = np.repeat([sizes[:3].max(), sizes[3:].max()], 3).tolist()
        for c, name in enumerate(WRENCH_CHANNELS):
            unit = "N" if c < 3 else "N m"
            states = _wrench_states(less)
            channels.append(_channel(name, unit, less.seconds, less.wrench[:, c], whole[c], states))
    if not channels:
        raise InputError(
            ErrorCode.TOPIC_MISSING, "the recordings have no wrench and no joint efforts in common: record one of them"
        )
    return Located(tuple(channels), matched)


def _channel(
    name: str, unit: str, seconds: Array, values: Array, reading: float, states: Sequence[tuple[str, Array]]
) -> LocatedChannel:
    noise = float(np.median(np.abs(np.diff(values))) / 0.6745 / np.sqrt(2.0))
    step = float(np.median(np.diff(seconds)))
    count = max(round(_BLOCK / step), 1)
    whole = len(values) // count * count
    calm = values[:whole].reshape(-1, count).mean(axis=1)
    size = float(np.sqrt(max(np.mean(calm**2) - noise**2 / count, 0.0)))
    limit = max(_NOISE * noise, _TOLERANCE * reading)
    if size <= limit:
        return LocatedChannel(name, unit, size, noise, float(reading), (), ())
    rows = [(state, columns[:whole].reshape(len(calm), count, -1).mean(axis=1)) for state, columns in states]
    times = seconds[:whole].reshape(-1, count).mean(axis=1)
    return LocatedChannel(name, unit, size, noise, float(reading), _shares(calm, rows), _windows(times, calm, limit))


def _shares(values: Array, states: Sequence[tuple[str, Array]]) -> tuple[tuple[str, float], ...]:
    """States in the order in which they explain most beyond the ones before, by least squares."""
    found: list[tuple[str, float]] = []
    left, used = list(states), np.zeros((len(values), 0))
    total, explained = float(values @ values), 0.0
    while left:
        tried = [_explained(values, np.column_stack([used, columns])) for _, columns in left]
        cost = [_COLUMN * columns.shape[1] for _, columns in left]
        gains = (np.array(tried) - explained) / max(total, 1e-300)
        best = int(np.argmax(gains - cost))
        gain = float(gains[best])
        if gain < _PART + cost[best] - _COLUMN:
            break
        name, columns = left.pop(best)
        found.append((name, gain))
        used, explained = np.column_stack([used, columns]), tried[best]
    return tuple(found)


def _explained(values: Array, columns: Array) -> float:
    solved = np.linalg.lstsq(columns, values, rcond=1e-9)[0]
    rest = values - columns @ solved
    return float(values @ values - rest @ rest)


def _joint_states(track: EffortTrack, joint: int) -> list[tuple[str, Array]]:
    """What the difference of a joint's effort may go with, and its columns (N, k)."""
    velocity, acceleration = track.velocity[:, joint], track.acceleration[:, joint]
    return [
        ("a constant", np.ones((len(velocity), 1))),
        ("the direction of its motion", np.tanh(velocity / _DIRECTION)[:, None]),
        ("its speed", velocity[:, None]),
        ("its acceleration", acceleration[:, None]),
        ("the posture", _posture(track.position)),
        ("time", (track.seconds - track.seconds.mean())[:, None]),
    ]


def _wrench_states(recorded: RecordedMotion) -> list[tuple[str, Array]]:
    joints = recorded.joints
    found = [("a constant", np.ones((len(recorded), 1)))]
    if joints is not None:
        found += [("the posture", _posture(joints.position)), ("the acceleration of the joints", joints.acceleration)]
        found.append(("the direction of motion", np.tanh(joints.velocity / _DIRECTION)))
    return [*found, ("time", (recorded.seconds - recorded.seconds.mean())[:, None])]


def _posture(position: Array) -> Array:
    """(N, k) sines and cosines of the joints and of sums of neighbours, in which weights vary."""
    angles = [position]
    for length in range(2, min(position.shape[1], 4) + 1):
        sums = np.cumsum(np.pad(position, ((0, 0), (1, 0))), axis=1)
        angles.append(sums[:, length:] - sums[:, :-length])
    wide = np.concatenate(angles, axis=1)
    return np.concatenate([np.sin(wide), np.cos(wide)], axis=1)


def _windows(seconds: Array, values: Array, limit: float) -> tuple[tuple[float, float], ...]:
    """Stretches whose size exceeds a limit."""
    step = float(np.median(np.diff(seconds)))
    count = max(round(_STRETCH / step), 1)
    size = np.sqrt(np.convolve(values**2, np.ones(count) / count, mode="same"))
    return _runs(seconds, size > limit)


def _runs(seconds: Array, mask: Mask) -> tuple[tuple[float, float], ...]:
    found: list[tuple[float, float]] = []
    for begin, end in runs(mask):
        start, stop = float(seconds[begin]), float(seconds[end])
        if found and start - found[-1][1] < 2.0 * _STRETCH:
            found[-1] = (found[-1][0], stop)
        elif stop - start > 0.2 * _STRETCH:
            found.append((start, stop))
    return tuple(found)
