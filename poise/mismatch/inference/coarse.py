"""A recording at a fifth of its rate, to screen many hypotheses before few are fitted in full."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.inference.noise import NoiseColour, SignalNoise
from poise.mismatch.inference.problem import Problem, SampleBlocks

_TOGETHER = 5
"""Samples that are averaged. Odd, so that one is in the middle."""
_ENOUGH = 500
"""Least number of samples after thinning; shorter recordings are not thinned."""


def thinned(problem: Problem) -> Problem:
    """The problem with every five samples averaged.

    Measurement, prediction and responses are averaged alike, after evaluation at the full rate: only what is faster
    than the averages is lost.
    """
    seconds = problem.seconds
    count = len(seconds) // _TOGETHER
    if count < _ENOUGH:
        return problem
    rows = np.arange(count * _TOGETHER).reshape(count, _TOGETHER)
    period = float(np.median(np.diff(seconds)))
    rows = rows[seconds[rows[:, -1]] - seconds[rows[:, 0]] < 1.5 * _TOGETHER * period]
    return replace(problem, blocks=SampleBlocks(rows, _thinned_noise(problem.noise, rows, _TOGETHER * period)))


def _thinned_noise(noise: SignalNoise, rows: NDArray[np.intp], span: float) -> SignalNoise:
    """White noise falls with the root of the number; what is slower than a group stays (Ornstein-Uhlenbeck mean)."""

    def kept(colour: NoiseColour) -> NoiseColour:
        x = span / colour.tau
        factor = float(np.sqrt(_TOGETHER * 2.0 * (x - 1.0 + np.exp(-x)) / x**2))
        return NoiseColour(colour.floor * factor, colour.slope * factor, colour.tau)

    colours = tuple(kept(colour) for colour in noise.colours)
    middle = rows[:, _TOGETHER // 2]
    return SignalNoise(
        noise.sigma / np.sqrt(_TOGETHER), noise.groups, colours, noise.seconds[middle], noise.speed[middle]
    )
