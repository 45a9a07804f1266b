"""A recording at a fifth of its rate, for looking through many hypotheses before few are fitted in full."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.noise import Colour, Noise
from poise.mismatch.problem import Problem
from poise.mismatch.world import World

Array = NDArray[np.float64]

TOGETHER = 5
"""Samples that become one. Odd, so that one of them is in the middle."""
ENOUGH = 500
"""Samples that a thinned recording has at the least; shorter ones stay as they are."""


def thinned(problem: Problem, whole: World) -> Problem:
    """The problem with every five samples of the wrench made one.

    What is averaged is the residual of a model; the middle sample's prediction is then put back. So the model's own
    course is not blurred, only what it does not explain.

    Args:
        problem: of a wrench; joint efforts are returned as they are.
        whole: the model's world, see `Problem.compose`.
    """
    count = len(problem.seconds) // TOGETHER
    if problem.signal != "wrench" or count < ENOUGH:
        return problem
    groups = np.arange(count * TOGETHER).reshape(count, TOGETHER)
    span = problem.seconds[groups[:, -1]] - problem.seconds[groups[:, 0]]
    groups = groups[span < 1.5 * TOGETHER * problem.world.period]
    middle = np.zeros(len(problem.seconds), dtype=bool)
    middle[groups[:, TOGETHER // 2]] = True
    residual = problem.measured - whole.prediction
    world = replace(
        problem.world.select(middle), wrench=whole.prediction[middle] + residual[groups].mean(axis=1), effort=None
    )
    return replace(problem, world=world, noise=_thinned_noise(problem.noise, world))


def _thinned_noise(noise: Noise, world: World) -> Noise:
    """White noise falls with the root of the number; what is slower than a group stays (Ornstein-Uhlenbeck mean)."""
    span = world.period

    def kept(colour: Colour) -> Colour:
        x = span / colour.tau
        factor = float(np.sqrt(TOGETHER * 2.0 * (x - 1.0 + np.exp(-x)) / x**2))
        return Colour(colour.floor * factor, colour.slope * factor, colour.tau)

    colours = tuple(kept(colour) for colour in noise.colours)
    return Noise(noise.sigma / np.sqrt(TOGETHER), noise.groups, colours, world.seconds, world.speed)
