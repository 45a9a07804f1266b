"""The test of a model's residual: is it noise or structure, and with which states does it correlate?

The test is absolute: the residual is compared with the size that sensor noise may have, not with its own whitened form
(an autoregressive filter can make any residual white).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import binary_opening, uniform_filter1d

from poise.mismatch.answer.residual_windows import explained, goes_with
from poise.mismatch.inference import MATERIAL_EXCESS, FittedEffect, Problem, allowed_excess, linear_bspline_basis
from poise.mismatch.recorded import block_means, rounding
from poise.types import Array

_LOUDER = 1.3
"""Fast noise with a larger ratio between fast and slow motion is no sensor noise."""
_FEW_DIFFERENCES = 100
"""Third differences below which a ratio of their sizes may be chance: of 100 it is uncertain by 0.1 to 0.15."""
_COARSE = 0.25
"""Share of the noise's power from which the rounding of the readings decides how their fast noise grows."""
_ONE_CHANNEL = 0.5
"""Energy of one channel, beyond the share that all channels may have, that is structure where the others have less."""

_SPIKE = 5.0
"""Sigmas to which single residuals are limited."""
_BURSTS, _FEWEST = ((10.0, 0.06), (20.0, 0.02)), 5
"""Sigmas, and s for which a residual beyond these is no spike and no noise, with the fewest samples: brief events in a
calm recording make its noise look coloured, and are within the energy that this may have."""
_WINDOW, _LASTING = 1.0, 5.0
"""s in which one channel's residual has this energy, in units of its noise, where something acts; of 60 signals of
healthy recordings (benchmarks.foreign, benchmarks.random_effects), the largest had 3.7."""
_REVERSES = 0.1
"""Share of the usual speed of a joint below which it may reverse: when its dry friction does is known to steps of the
encoder."""
_APART = 0.5
"""s between bursts of different events."""
_BESIDE = 0.15
"""s at the begin and the end of a named event in which its course is not known as exactly."""


@dataclass(frozen=True)
class ResidualTest:
    """The result of the test.

    Args:
        excess: energy of the residual over that of the noise, less one.
        channel: the name of the channel, or joint, with a residual where the others have none; "".
        of_channel: its excess; that of all channels where there is none.
        structured: the residual exceeds the noise.
        louder: its fast part grows with the speed.
        depends_on: states that it correlates with, the best first.
        whiteness: largest autocorrelation of the whitened residual at one to twenty samples, any channel.
        bursts: s, when something acts shortly that no noise of any family does, where the energy of the whole
            recording is that of noise.
    """

    excess: float
    channel: str
    of_channel: float
    structured: bool
    louder: bool
    depends_on: tuple[str, ...]
    whiteness: float
    bursts: tuple[float, ...] = ()

    @property
    def only_louder(self) -> bool:
        """Only fast noise that grows with the speed; it is within the size of noise and does not question the names."""
        return self.louder and self.excess <= MATERIAL_EXCESS


def judge_residual(
    problem: Problem,
    residual: Array,
    whitened: Array,
    rounded: Array | float = 0.0,
    named: Sequence[FittedEffect] = (),
) -> ResidualTest:
    """Test a residual (N, C) and its whitened form (R,).

    Args:
        problem, residual, whitened: see above.
        rounded: (C,) rounding of the readings, one sigma, which is no structure.
        named: the effects of the answer, whose own events are no bursts.
    """
    scaled, seconds = (residual / problem.noise.total)[problem.active], problem.seconds[problem.active]
    energy, free = _energies(problem, residual)
    excess, material = _excess(energy, free), allowed_excess(problem)
    loud = _louder_when_fast(problem, residual)
    allowance = np.broadcast_to((rounded / problem.noise.sigma) ** 2, energy.shape)
    allowed = material + float(np.mean(allowance))
    each = energy / np.maximum(free, 1.0) - 1.0
    worst = int(np.argmax(each - allowance))
    alone = excess <= allowed and each[worst] - allowance[worst] > material + _ONE_CHANNEL
    structured = excess > allowed or loud or alone
    bursts = () if structured else bursts_of(problem, residual, named)
    depends = _depends(problem, seconds, scaled, loud) if structured else ()
    white = _strongest_correlation(whitened.reshape(residual.shape[1], -1))
    channel = problem.channels[worst] if alone else ""
    of_channel = float(each[worst]) if alone else excess
    if bursts:
        structured, depends = True, ("time",)
    return ResidualTest(excess, channel, of_channel, structured, loud, depends, white, bursts)


def excess_of(problem: Problem, residual: Array) -> float:
    """Energy of a residual (N, C) over that of the noise, less one."""
    return _excess(*_energies(problem, residual))


def _excess(energy: Array, free: Array) -> float:
    return float(energy.sum() / max(float(free.sum()), 1.0)) - 1.0


def _energies(problem: Problem, residual: Array) -> tuple[Array, Array]:
    """(C,) energy of each channel of a residual in units of its noise, and (C,) the readings that count."""
    # A few spikes are no structure: residuals are limited to five sigmas.
    scaled = np.clip((residual / problem.noise.total)[problem.active], -_SPIKE, _SPIKE)
    return np.sum(scaled**2, axis=0), np.asarray(problem.free[problem.active].sum(axis=0))


def bursts_of(problem: Problem, residual: Array, named: Sequence[FittedEffect]) -> tuple[float, ...]:
    """The middle times, s, when a residual (N, C) has in one channel what noise has not: outside the named events."""
    seconds = problem.seconds
    judged = problem.active.copy()
    for part in named:
        for begin, end in part.effect.windows(problem.recorded, part.values):
            edges = [(begin, end)] if part.effect.free(part.values) else [(begin, begin), (end, end)]
            for first, last in edges:
                judged &= (seconds < first - _BESIDE) | (seconds > last + _BESIDE)
    known = judged[:, None] & (problem.free > 0.0)
    track = problem.recorded.effort
    if problem.signal == "effort" and track is not None:
        known &= np.abs(track.velocity) > _REVERSES * track.speeds
    scaled = np.where(known, np.abs(residual) / problem.noise.total, 0.0)
    period = float(np.median(np.diff(seconds)))
    lasting = np.zeros(len(seconds), dtype=bool)
    for sigmas, least in _BURSTS:
        length = max(round(least / period), _FEWEST)
        lasting |= binary_opening(scaled > sigmas, np.ones((length, 1))).any(axis=1)
    length = max(round(_WINDOW / period), 1)
    energy = uniform_filter1d(np.minimum(scaled, _SPIKE) ** 2, length, axis=0, mode="constant")
    lasting |= (energy > _LASTING).any(axis=1)
    when = seconds[lasting]
    groups = np.split(when, np.flatnonzero(np.diff(when) > _APART) + 1)
    return tuple(float(group[0] + group[-1]) / 2 for group in groups if len(group))


def _depends(problem: Problem, seconds: Array, scaled: Array, loud: bool) -> tuple[str, ...]:
    if loud:
        return ("joint_velocity",)
    direct = goes_with(problem.recorded, seconds, scaled, slice(None)) if len(seconds) == len(problem.recorded) else []
    if direct:
        return tuple(direct)
    energy = np.clip(scaled**2, 0.0, 25.0).sum(axis=1, keepdims=True)
    energy = energy - energy.mean()
    rows = problem.active
    speed, load = problem.noise.speed[rows], np.linalg.norm(problem.predicted(problem.recorded)[rows], axis=1)
    curves = {"joint_velocity": speed, "load": load, "time": seconds}
    shares = {name: explained(linear_bspline_basis(values, 10), energy) for name, values in curves.items()}
    best = max(shares, key=lambda name: shares[name])
    return (best,) if shares[best] > 0.1 else ("time",)


def _louder_when_fast(problem: Problem, residual: Array) -> bool:
    """Whether third differences, which slow changes do not affect, grow with the speed more than the noise may.

    Their mean square and their median have to grow: corners of a motion raise a few of them only.
    """
    noise, block = problem.noise, problem.noise.block
    still = np.broadcast_to(noise.sigma**2 / block, residual.shape)
    moving = still if noise.motion is None else still + noise.motion
    level_still, level, speed = (block_means(each, block)[2:-1] for each in (still, moving, noise.speed))
    fast = np.abs(np.diff(block_means(residual, block), n=3, axis=0))
    # Limited readings have no noise; coarse ones change the less often, the slower the load changes.
    free = sliding_window_view(block_means(problem.free, block), 4, axis=0).min(axis=-1) == 1.0
    steps = np.array([rounding(column) for column in problem.measured.T])
    free = free & (steps**2 < _COARSE * noise.sigma**2 / block)
    # Readings that are not compared (joints at rest, held by dry friction) say nothing of either speed.
    slow, quick = np.quantile(speed[free.any(axis=1)], [0.3, 0.7]) if free.any() else (0.0, 0.0)
    if quick - slow < 0.1:
        return False
    # Encoders that count steps err less while the steps are rare.
    halves = [
        np.clip((fast[at] / np.sqrt(20.0 * of[at]))[free[at]], 0.0, 8.0)
        for at, of in ((speed <= slow, level_still), (speed >= quick, level))
    ]
    if min(map(len, halves)) < _FEW_DIFFERENCES:
        return False
    sizes = ([float(measure(half)) for half in halves] for measure in (_root_mean_square, np.median))
    return all(after > _LOUDER * before for before, after in sizes)


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _strongest_correlation(whitened: Array) -> float:
    """Of (C, N) channels, the largest magnitude among the first twenty autocorrelations."""
    centred = whitened - whitened.mean(axis=1, keepdims=True)
    power = np.maximum(np.sum(centred**2, axis=1), 1e-12)
    lags = [np.abs(np.sum(centred[:, :-lag] * centred[:, lag:], axis=1) / power).max() for lag in range(1, 21)]
    return float(max(lags))
