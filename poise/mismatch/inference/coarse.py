"""A recording at a lower rate, to screen many hypotheses before few are fitted in full."""

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.inference.noise import SignalNoise, kept_share
from poise.mismatch.inference.problem import Problem, SampleBlocks
from poise.mismatch.recorded import EffortTrack
from poise.types import Array

_FEWEST, _SPAN = 5, 0.04
"""Samples that are averaged, at the least, and s that they span. Odd, so that one is in the middle."""
_ENOUGH = 500
"""Least number of samples after thinning; shorter recordings are not thinned."""


def thinned(problem: Problem) -> Problem:
    """The problem with consecutive samples averaged.

    Measurement, prediction and responses are averaged alike, after evaluation at the full rate: only what is faster
    than the averages is lost.
    """
    seconds = problem.seconds
    period = float(np.median(np.diff(seconds)))
    together = max(_FEWEST, 2 * int(_SPAN / period / 2.0) + 1)
    count = len(seconds) // together
    if count < _ENOUGH:
        return problem
    rows = np.arange(count * together).reshape(count, together)
    rows = rows[seconds[rows[:, -1]] - seconds[rows[:, 0]] < 1.5 * together * period]
    return replace(problem, blocks=SampleBlocks(rows, _thinned_noise(problem.noise, rows, together * period)))


def _thinned_noise(noise: SignalNoise, rows: NDArray[np.intp], span: float) -> SignalNoise:
    """White noise falls with the root of the number; of what is slower than a block the mean's part stays."""
    together = rows.shape[1]
    kept = kept_share(span, np.array([colour.tau for colour in noise.colours]))
    colours = tuple(
        replace(colour, floor=colour.floor * factor, slope=colour.slope * factor)
        for colour, factor in zip(noise.colours, np.sqrt(kept * together).tolist(), strict=True)
    )
    middle = rows[:, together // 2]
    return SignalNoise(
        noise.sigma / np.sqrt(together),
        colours,
        noise.seconds[middle],
        noise.speed[middle],
        np.minimum(noise.share * together, 1.0),
        np.minimum(noise.band * together, 1.0),
        -(-noise.block // together),
        None if noise.motion is None else noise.motion[middle] * kept,
    )


def averaged_efforts(effort: EffortTrack, groups: NDArray[np.intp]) -> EffortTrack:
    """Efforts with the samples of each row of groups (R, n) averaged."""

    def mean(values: Array) -> Array:
        return np.asarray(values[groups].mean(axis=1))

    changes: dict[str, object] = {
        each.name: mean(getattr(effort, each.name))
        for each in fields(effort)
        if isinstance(getattr(effort, each.name), np.ndarray)
    }
    changes["stuck"] = None
    if effort.links is not None:
        names, columns = effort.links.base_parameters
        before = effort.links
        links = replace(before, efforts=mean(before.efforts), by_parameter=mean(before.by_parameter))
        links.__dict__["base_parameters"] = names, mean(columns)  # the same parameters as at the full rate
        changes["links"] = links
    return replace(effort, **changes)  # type: ignore[arg-type]
