"""Variations of an effect: does the residual show that its response should vary over the recording?

An effect that is right acts with the same parameters at all times, places and speeds. One that only resembles the true
cause leaves structure in the directions of its own response: it would have to be stronger at other moments, in other
channels, or later. Each kind of variation is a small linear model beside the answer, compared by its evidence (a
posterior predictive check in the directions of the effect: Gelman, Meng and Stern 1996, "Posterior predictive
assessment of model fitness via realized discrepancies").
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from poise.mismatch.inference.coarse import thinned
from poise.mismatch.inference.evidence import WhitenedRegression
from poise.mismatch.inference.fitting import fit
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.inference.unknown import linear_bspline_basis
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_SIZE = 0.2
"""One sigma of the prior of a variation, relative to the effect."""
_ACTS = 1e-3
"""Share of its largest energy in a sample from which an effect acts there. Where it hardly acts, it would have to vary
by many times its own size to explain what stays there: that is another effect, or an error of the motion."""
_TIME, _STATE = 5, 4
"""Knots of an amplitude that varies with time, or with a scalar state."""
_SEEN = 0.003
"""Share of an effect's energy from which a channel may have a gain of its own."""
_EVEN = 1e-6
"""Scatter of a function below which it is constant where the effect acts."""


@dataclass(frozen=True)
class Variation:
    """The variation of an effect that the residual supports most: with what, and the log evidence that it wins."""

    state: str
    gain: float


def variations(problem: Problem, parts: Sequence[FittedEffect]) -> tuple[Variation, ...]:
    """The strongest variation of each effect of an answer, in the order of the parts.

    The windows of other events are left out: residuals there are their details.

    Args:
        problem: under the noise that the answer leaves.
        parts: the answer.
    """
    if not parts:
        return ()
    problem = problem.weighed()
    coarse = problem.blocks is None and not any(part.effect.fast for part in parts)
    usual = _fitted(problem, parts, coarse)
    found = []
    for part in parts:
        if part.effect.knocks or part.effect.varies:
            found.append(Variation("", 0.0))
            continue
        rest = [other for other in parts if other is not part]
        calm = problem.calm(rest)
        found.append(_strongest(*(usual if calm is problem else _fitted(calm, parts, coarse)), rest))
    return tuple(found)


def _fitted(problem: Problem, parts: Sequence[FittedEffect], coarse: bool) -> tuple[Problem, WhitenedRegression, Array]:
    """The problem at the rate of the comparison, its regression, and the prediction (N, C)."""
    problem = thinned(problem) if coarse else problem
    return problem, fit(problem, parts, 0).regression, problem.predicted(problem.compose(parts)[1])


def _strongest(
    problem: Problem, regression: WhitenedRegression, whole: Array, rest: Sequence[FittedEffect]
) -> Variation:
    """The variation of the part that `rest` lacks which wins most."""
    response = whole - problem.predicted(problem.compose(rest)[1])
    gains = {}
    for state, columns in _kinds(problem, response, whole):
        projected = regression.project(problem.whiten(columns))
        gains[state] = projected.gain(np.full(columns.shape[2], _SIZE**-2.0))
    best = max(gains, key=gains.__getitem__, default="")
    return Variation(best, max(gains.get(best, 0.0), 0.0))


def _kinds(problem: Problem, response: Array, whole: Array) -> Iterator[tuple[str, Array]]:
    """(state, (N, C, k) columns) of each kind of variation of a response (N, C) within the whole prediction (N, C)."""
    energy = np.sum((response / problem.noise.sigma) ** 2, axis=1) + 1e-300
    acts = energy > _ACTS * energy.max()
    for state, functions in _functions(problem, np.sqrt(energy), acts):
        relative = _standardised(functions, energy)
        if relative.shape[1]:
            yield state, response[:, :, None] * (relative * acts[:, None])[:, None, :]
    share = np.sum((response / problem.noise.sigma) ** 2, axis=0)
    seen = np.flatnonzero(share > _SEEN * share.sum())
    if len(seen) > 1:
        yield "channel", response[:, :, None] * np.eye(response.shape[1])[:, seen[:-1]]
    rate = np.gradient(response, problem.seconds, axis=0)
    if problem.signal == "effort":  # all efforts may be early or late, also by more than the calibration allows
        late = np.gradient(whole, problem.seconds, axis=0)
        weight = problem.noise.sigma**-2.0
        rate = rate - late * np.sum(rate * late * weight) / max(float(np.sum(late**2 * weight)), 1e-300)
    size = np.sqrt(np.sum(response**2) / max(float(np.sum(rate**2)), 1e-300))
    yield "delay", rate[:, :, None] * size
    yield "sign", np.where(response > 0.0, 0.5, -0.5)[:, :, None] * response[:, :, None]


def _functions(problem: Problem, size: Array, acts: Array) -> Iterator[tuple[str, Array]]:
    """(state, (N, k) functions) with which an amplitude may vary; `acts` (N,): where the effect does."""

    def over(values: Array, count: int) -> Array:
        inside = values[acts]
        if np.ptp(inside) <= _EVEN * max(float(np.abs(inside).max()), 1.0):
            return np.zeros((len(values), 0))
        return linear_bspline_basis(np.clip(values, inside.min(), inside.max()), count)[:, :-1]

    recorded: RecordedMotion = problem.recorded
    yield "time", over(problem.seconds, _TIME)
    yield "speed", over(problem.noise.speed, _STATE)
    yield "size", over(size, _STATE)
    if problem.signal == "effort" and recorded.effort is not None:
        yield "position", recorded.effort.position
        yield "velocity", recorded.effort.velocity
        yield "load", np.abs(recorded.effort.prediction)
    else:
        yield "gravity_direction", recorded.gravity
        yield "position", recorded.position_in_world if recorded.joints is None else recorded.joints.position
        yield "velocity", recorded.velocity_in_world


def _standardised(functions: Array, weight: Array) -> Array:
    """Functions (N, k) less their means, with unit scatter, both weighed (N,); without those that are constant."""
    share = weight / weight.sum()
    centred = functions - share @ functions
    scatter = np.sqrt(share @ centred**2)
    kept = scatter > _EVEN * np.maximum(np.abs(functions).max(axis=0, initial=0.0), 1e-9)
    return np.asarray(centred[:, kept] / scatter[kept])
