"""Errors of a driver in joint efforts: repeated readings, limits, order of joints, delays, subtracted weight."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from poise.mismatch.effects import at_ends, bristles_along, within
from poise.mismatch.reading.findings import InputFinding, turned_base
from poise.mismatch.reading.joint_input import orders
from poise.mismatch.reading.sanity import covered, frozen_spans, stuck_spans
from poise.mismatch.recorded import (
    EffortTrack,
    RecordedMotion,
    joint_torques,
    linear_at,
    load_wrench,
    white_level,
)
from poise.types import Array

_SLOW = (0.001, 0.01, 0.1)
"""rad/s or m/s: widths of the friction that is fitted beside the model."""
_BENT = (1e-4, 1e-3)
"""rad or m along which bristles bend after a reversal: friction that reverses along a path resembles a delay."""
_SAMPLES = 1000
"""Samples of the recording that are compared."""
_AUDIBLE = 50.0
"""Variance of an effort, in units of its noise, at which it counts half."""
_MATERIAL, _BETTER, _AT_MOST = 0.005, 0.2, 0.4
"""Share of the variance that the model leaves at least; largest ratio of what an error of the driver leaves, without
and with what no error explains."""
_LONGEST_LAG, _SHORTEST_LAG = 1.0, 0.02
"""s: delays that are looked for."""
_LEAST_MOVED, _LAG_STEP, _HALF = 0.008, 0.001, 0.5
"""s: shorter delay from which efforts are moved, twice the usual tolerance of a clock, and its resolution; largest
ratio of what the delay leaves, over all joints and in each of them, with and without it."""
_CLEAR = 10.0
"""Sigmas of a noise of `_SAMPLES` samples by which a delay lowers what the model leaves at least."""
_LEAST_MOUNTING, _OWN_WEIGHT = 20.0, 2.0
"""degrees by which a base is turned at least, smaller tilts being an effect of the library; factor by which the weight
may differ beside it."""
_LOST, _MOVES = 0.5, 0.01
"""Share of the samples from which joints at their limits are left out, and not the samples; and of a span in which a
joint moves faster than so many rad/s or m/s."""


def usable_efforts(track: EffortTrack) -> tuple[EffortTrack, list[InputFinding]]:
    """The efforts without spans that repeat one reading and without readings at a limit, and what was left out."""
    spans = [(track.names, span) for span in frozen_spans(track.seconds, track.measured, track.rigid)]
    whole = [span for _, span in spans]
    spans += [(names, span) for names, span in _stuck(track) if not covered(span, whole)]
    found = [
        InputFinding(
            "effort_frozen",
            f"{'The efforts repeat' if names == track.names else f'The effort of {names[0]} repeats'} one reading from "
            f"{begin:.2f} s to {end:.2f} s, though the arm moves: their driver stopped; this span was left out.",
            names,
            (begin, end),
        )
        for names, (begin, end) in spans
    ]
    track = track.select(~within(track.seconds, [span for _, span in spans])) if spans else track
    track, limited = _below_limits(track)
    return track, [*found, *limited]


def _stuck(track: EffortTrack) -> list[tuple[tuple[str, ...], tuple[float, float]]]:
    """Joints whose effort alone repeats one reading while they move: at rest, friction may carry any load."""
    found: list[tuple[tuple[str, ...], tuple[float, float]]] = []
    for j, name in enumerate(track.names):
        for begin, end in stuck_spans(track.seconds, track.measured[:, j], track.rigid[:, j]):
            inside = (track.seconds >= begin) & (track.seconds <= end)
            if np.mean(np.abs(track.velocity[inside, j]) > _MOVES) > _LOST:
                found.append(((name,), (begin, end)))
    return found


def _below_limits(track: EffortTrack) -> tuple[EffortTrack, list[InputFinding]]:
    limited = at_ends(track.measured, track.rigid)
    if not limited.any():
        return track, []
    at_limit, rows = np.asarray(limited.any(axis=0)), np.asarray(limited.any(axis=1))
    names, every = track.named(at_limit), limited.mean(axis=0)[at_limit]
    limits = tuple(np.where(limited, np.abs(track.measured), 0.0).max(axis=0)[at_limit].tolist())
    said = ", ".join(
        f"{name} at {limit:.4g} in {share:.1%}" for name, limit, share in zip(names, limits, every, strict=True)
    )
    whole = bool(rows.mean() > _LOST)
    left = "these joints" if whole else "these samples"
    sentence = (
        f"Efforts stay at the end of their range, though the load changes: {said} of the samples; {left} were left out."
    )
    track = track.of_joints(~at_limit) if whole else track.select(~rows)
    return track, [InputFinding("effort_limited", sentence, names, limits)]


def offset_and_friction(velocity: Array) -> list[Array]:
    """Columns of an offset, and of viscous and dry friction at the velocities (N,) of a joint, (N,) each."""
    return [np.ones(len(velocity)), velocity, *(np.tanh(velocity / slow) for slow in _SLOW)]


@dataclass(frozen=True, eq=False)
class EffortComparison:
    """Efforts of a recording against models, each beside friction, rotor and offset.

    Args:
        track: the efforts. rows: (n,) those that are compared.
    """

    track: EffortTrack
    rows: Array

    @staticmethod
    def of(track: EffortTrack) -> "EffortComparison":
        return EffortComparison(track, np.unique(np.linspace(0, len(track.seconds) - 1, _SAMPLES).astype(int)))

    def bases(self, model: Array) -> list[Array]:
        """(n, 9) orthonormal columns of each joint, with the model's effort (M, J) among them."""
        columns = zip(self.beside, model[self.rows].T, strict=True)
        return [np.linalg.qr(np.column_stack(pair))[0] for pair in columns]

    def left(self, measured: Array, bases: list[Array]) -> Array:
        """(J,) share of the variance of efforts (n, J) that the models leave above the noise; less of faint ones."""
        residual = np.stack([y - base @ (base.T @ y) for y, base in zip(measured.T, bases, strict=True)], axis=1)
        audible = np.maximum(np.mean(residual**2, axis=0) - self.noise, 0.0)
        return np.asarray(audible / (np.var(measured, axis=0) + self.faint))

    @cached_property
    def beside(self) -> list[Array]:
        """(n, 8) of each joint: offset, friction and rotor."""
        track, rows = self.track, self.rows
        bent = [each[rows] for each in bristles_along(track, _BENT)]
        found = []
        for j in range(len(track.names)):
            friction = *offset_and_friction(track.velocity[rows, j]), *(each[:, j] for each in bent)
            found.append(np.stack([*friction, track.acceleration[rows, j]], axis=1))
        return found

    @cached_property
    def measured(self) -> Array:
        """(n, J) efforts that were read."""
        return np.asarray(self.track.measured[self.rows])

    @cached_property
    def noise(self) -> Array:
        """(J,) variance."""
        return np.asarray(white_level(self.track.measured) ** 2)

    @property
    def faint(self) -> Array:
        """(J,) variance of an effort that counts half."""
        return np.asarray(np.maximum(_AUDIBLE * self.noise, 1e-12))

    def earlier(self, lag: float) -> Array:
        """(n, J) efforts that were read `lag` (s) later."""
        track = self.track
        return linear_at(track.seconds, track.measured, track.seconds[self.rows] + lag)


def driver_error(recorded: RecordedMotion, track: EffortTrack) -> InputFinding | None:
    """What a driver did to efforts that the model does not explain, where one error explains them.

    Args:
        recorded: the motion, with the load.
        track: the efforts, as measured.
    """
    comparison = EffortComparison.of(track)
    bases = comparison.bases(track.rigid)
    as_read = comparison.left(comparison.measured, bases)
    if as_read.max() < _MATERIAL:
        return None
    tried = [
        *_in_order(comparison, bases),
        *_late(comparison, bases),
        *_compensated(comparison, recorded),
        *_mounted(comparison, recorded),
    ]
    left, finding = min(tried, key=lambda each: float(each[0].sum()))
    concerned = np.isin(track.names, finding.joints)
    before, after = float(as_read[concerned].mean()), float(left[concerned].mean())
    floor = float(np.min([as_read, *(each for each, _ in tried)], axis=0)[concerned].mean())
    explains = after < _AT_MOST * before and after - floor < _BETTER * (before - floor)
    return finding if explains and before - floor > _MATERIAL else None


def without_delay(track: EffortTrack) -> tuple[EffortTrack, list[InputFinding]]:
    """Efforts at the time of their motion, where they are late or early by 8 to 20 ms, and what was found.

    Late weight resembles friction and coupled motors. All joints of an arm have one delay; that of a single joint is
    not distinguished from its friction. Delays from 20 ms on are those of `driver_error`.

    Args:
        track: the efforts, without readings at limits.
    """
    comparison = EffortComparison.of(track)
    if len(track.names) < 2 or len(comparison.rows) < _SAMPLES // 2:
        return track, []
    bases = comparison.bases(track.rigid)

    def left(lag: float) -> Array:
        return comparison.left(comparison.earlier(lag), bases)

    most = round(_SHORTEST_LAG / _LAG_STEP)
    lag = min((_LAG_STEP * step for step in range(-most, most + 1)), key=lambda each: float(left(each).sum()))
    before, after = left(0.0), left(lag)
    noise = comparison.noise / (np.var(comparison.measured, axis=0) + comparison.faint)
    chance = _CLEAR * np.sqrt(2.0 / len(comparison.rows)) * noise
    falls = (after <= _HALF * before) & (before - after > chance)
    # Soft friction leaves a lag in the joints whose motion shows it, and none in the others.
    stays = (after > _HALF * before) & (after > chance)
    if abs(lag) < _LEAST_MOVED or after.sum() > _HALF * before.sum() or falls.sum() < 2 or stays.any():
        return track, []
    late = _late_by(track, lag, f"{1e3 * abs(lag):.0f} ms", "moved by it")
    later = track.seconds + lag
    moved = replace(track, measured=linear_at(track.seconds, track.measured, later))
    index = np.clip(np.searchsorted(track.seconds, later), 1, len(track.seconds) - 1)
    beside = track.seconds[index] - track.seconds[index - 1] < 2.0 * track.period
    inside = (later >= track.seconds[0]) & (later <= track.seconds[-1])
    return moved.select(beside & inside), [late]


def _late_by(track: EffortTrack, lag: float, size: str, done: str) -> InputFinding:
    sentence = (
        f"The efforts follow from the motion if they are {size} {'late' if lag > 0 else 'early'} beside the positions; "
        f"they were {done}: correct the driver or its filter."
    )
    return InputFinding("effort_late", sentence, track.names, (lag,))


_Tried = Iterator[tuple[Array, InputFinding]]


def _in_order(comparison: EffortComparison, bases: list[Array]) -> _Tried:
    names = comparison.track.names
    for sentence, order in orders(names):
        left = comparison.left(comparison.measured[:, order], bases)
        concerned = comparison.track.named(order != np.arange(len(names)))
        yield (
            left,
            InputFinding(
                "effort_order",
                f"The efforts follow from the motion if {sentence}; they were left out: correct the driver.",
                concerned,
            ),
        )


def _late(comparison: EffortComparison, bases: list[Array]) -> _Tried:
    track = comparison.track
    step = max(track.period, _SHORTEST_LAG / 2.0)
    most = int(_LONGEST_LAG / step)
    for shift in range(-most, most + 1):
        lag = shift * step
        if abs(lag) < _SHORTEST_LAG:
            continue
        yield comparison.left(comparison.earlier(lag), bases), _late_by(track, lag, f"{abs(lag):.2f} s", "left out")


def _compensated(comparison: EffortComparison, recorded: RecordedMotion) -> _Tried:
    track = comparison.track
    if track.by_gravity is None:
        return
    weight = -float(np.linalg.norm(recorded.gravity[0])) * track.by_gravity[..., 2]
    still = np.zeros((len(recorded), 3))
    of_load = load_wrench(recorded.phi, recorded.gravity, still, still)
    load_weight = joint_torques(replace(recorded, effort=track), of_load[..., None])[..., 0]
    for what, subtracted in (("the arm", weight - load_weight), ("the arm and its load", weight)):
        left = comparison.left(comparison.measured, comparison.bases(track.rigid - subtracted))
        sentence = (
            f"The efforts follow from the motion without the weight of {what}: the driver subtracts it. They were left "
            "out; record the torques of the joints as measured."
        )
        yield left, InputFinding("effort_compensated", sentence, track.names)


def _mounted(comparison: EffortComparison, recorded: RecordedMotion) -> _Tried:
    """Gravity along another direction of the base than downwards."""
    track = comparison.track
    if track.by_gravity is None:
        return
    usual, rows = float(np.linalg.norm(recorded.gravity[0])), comparison.rows
    weightless = track.rigid + usual * track.by_gravity[..., 2]
    by_axis = track.by_gravity @ recorded.axes_of_base(track.seconds)
    beside = comparison.bases(np.zeros_like(track.rigid))
    rest = comparison.measured - weightless[rows]
    scale = 1.0 / np.sqrt(np.var(comparison.measured, axis=0) + comparison.faint)
    both = np.concatenate([by_axis[rows], rest[:, :, None]], axis=2) * scale[:, None]
    free = np.concatenate([both[:, j] - basis @ (basis.T @ both[:, j]) for j, basis in enumerate(beside)])
    along = np.asarray(np.linalg.lstsq(free[:, :3], free[:, 3], rcond=1e-3)[0])
    size, (angle, words) = float(np.linalg.norm(along)), turned_base(along)
    if angle < _LEAST_MOUNTING or not 1.0 / _OWN_WEIGHT < size / usual < _OWN_WEIGHT:
        return
    turned = comparison.bases(weightless + by_axis @ (along * usual / size))
    left = comparison.left(comparison.measured, turned)
    sentence = f"The efforts follow from the motion if gravity acts {words}. They were left out."
    yield left, InputFinding("base_turned", sentence, track.names)
