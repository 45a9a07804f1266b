"""One effect beside a fixed regression: at its starting points, and refined from one of them."""

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from poise.mismatch.effects import Effect, EffectParameter, Values
from poise.mismatch.inference.damping import SETTLED, Damping
from poise.mismatch.inference.evidence import ProjectedColumns, WhitenedRegression, flat_width
from poise.mismatch.inference.linearised import PRIOR_SCALES, acting_columns, acting_parameters, slope_of
from poise.mismatch.inference.problem import Problem
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_MOST_STEPS = 12
_ROUGH_STARTS = 3
"""Starting points from which an effect is refined if they may explain little of what a fit explains."""
_HOPE = 5.0
"""Largest ratio of the gain of a step to the prediction of the linear model."""
_FARTHEST = 0.5
"""s by which the moment of an event is moved first; half as much where that explains no more, to its resolution."""
_HOPELESS = -15.0
"""log evidence of an effect below which a bound suffices."""


@dataclass(frozen=True, eq=False)
class EffectCandidate:
    """One effect added to a regression: its values, and its gain of log evidence.

    Args:
        effect, values, gain, drop: its most likely values; log evidence won, and fall of the square.
        potential: upper estimate of the log evidence that it can win.
        visibility: sigmas of its response at its typical size.
        same: its response is that of the effect which it could replace: no data of this motion distinguish them.
    """

    effect: Effect
    values: Values
    gain: float
    drop: float
    potential: float
    visibility: float = np.inf
    same: bool = False


@dataclass(frozen=True, eq=False)
class _Point:
    """An effect at some values: its whitened columns and response, and the decrease of the square.

    `weak`: precision of the priors of the columns.
    """

    values: dict[str, float]
    columns: Array
    response: Array
    drop: float
    projected: ProjectedColumns
    weak: Array


def refine(
    problem: Problem,
    regression: WhitenedRegression,
    recorded: RecordedMotion,
    effect: Effect,
    start: Values,
    steps: int = _MOST_STEPS,
    least: float = -np.inf,
) -> EffectCandidate:
    """The most likely parameters of one effect beside a fixed regression, from a starting point.

    Args:
        problem: whitens.
        regression: the columns fitted beside it.
        recorded: that the effect acts in.
        effect: to fit.
        start: non-linear values; moments of events are moved near it before all others are refined.
        steps: at the most.
        least: gain of interest: the search ends as soon as it is out of reach.
    """
    parameters = acting_parameters(effect, recorded, start)
    moving = [p for p in parameters if not (p.linear or p.choice or p.resolution)]
    at = _timed(problem, regression, recorded, effect, _linear(problem, regression, recorded, effect, dict(start)))
    damping = Damping()
    for _ in range(steps if moving else 0):
        slopes = _slopes(problem, recorded, effect, at, moving)
        moved = _stepped(problem, regression, recorded, effect, at, moving, slopes, damping, least)
        if moved is None:
            break
        settled = moved.drop - at.drop < SETTLED
        at = moved
        if settled:
            break
    slopes = _slopes(problem, recorded, effect, at, moving)
    gain = _evidence_gain(regression, at, parameters, slopes) + discrete_prior(parameters)
    return EffectCandidate(effect, at.values, gain, at.drop, gain)


def _timed(
    problem: Problem, regression: WhitenedRegression, recorded: RecordedMotion, effect: Effect, at: _Point
) -> _Point:
    """With the moments near a start that explain most beside the regression; the start looks at constants alone."""
    moments = [p for p in acting_parameters(effect, recorded, at.values) if p.resolution and p.unit == "s"]
    step = _FARTHEST
    while step >= min((p.resolution for p in moments), default=np.inf):
        moved = [{**at.values, p.name: at.values[p.name] + s} for p in moments for s in (-step, step)]
        inside = [each for each in moved if all(p.low <= each[p.name] <= p.high for p in moments)]
        tried = [_linear(problem, regression, recorded, effect, each) for each in inside]
        best = max(tried, key=lambda each: each.drop, default=at)
        if best.drop > at.drop + SETTLED:
            at = best
        else:
            step /= 2.0
    return at


def score_starts(
    problem: Problem, regression: WhitenedRegression, recorded: RecordedMotion, effect: Effect, starts: Iterable[Values]
) -> list[EffectCandidate]:
    """One effect beside a regression at its best starting points; its potential is the gain beyond chance."""
    by_law: dict[str, list[dict[str, float]]] = {}
    for start in starts:
        by_law.setdefault(effect.law(start), []).append(dict(start))
    scored = []
    for group in by_law.values():
        tried = (_linear(problem, regression, recorded, effect, start) for start in group)
        best = heapq.nlargest(_ROUGH_STARTS if effect.rough else 1, tried, key=lambda each: each.drop)
        scored.append([_scored(regression, recorded, effect, at) for at in best])
    return [each for group in sorted(scored, key=lambda group: -group[0].potential) for each in group]


def _scored(regression: WhitenedRegression, recorded: RecordedMotion, effect: Effect, at: _Point) -> EffectCandidate:
    """One effect at a starting point."""
    parameters = acting_parameters(effect, recorded, at.values)
    free = sum(not p.choice for p in parameters)
    slopes = np.zeros((0, len(at.response)))
    gain = _evidence_gain(regression, at, parameters, slopes) + discrete_prior(parameters)
    moving = any(not p.linear for p in parameters)
    typical = np.array([p.scale for p in parameters if p.linear])
    visibility = float(np.sqrt(np.max(np.diag(at.projected.information) * typical**2))) if len(typical) else np.inf
    # Without linear parameters the value at a starting point says nothing; only the slopes do.
    potential = np.inf if not len(typical) else 0.5 * (at.drop - free) if moving else gain
    return EffectCandidate(effect, at.values, gain, at.drop, potential, visibility)


def _linear(
    problem: Problem,
    regression: WhitenedRegression,
    recorded: RecordedMotion,
    effect: Effect,
    nonlinear: dict[str, float],
) -> _Point:
    """The most likely linear parameters at given non-linear ones; 0 for those that do not act."""
    parameters = [p for p in acting_parameters(effect, recorded, nonlinear) if p.linear]
    if not parameters:
        response = problem.whiten(effect.simulate(recorded, nonlinear))
        drop, none = regression.project(response[None]).drop(np.ones(1)), np.zeros((0, len(response)))
        return _Point(nonlinear, none, response, drop, regression.project(none), np.zeros(0))
    columns = problem.whiten(acting_columns(effect, recorded, nonlinear))
    projected = regression.project(columns)
    weak = np.array([(PRIOR_SCALES[-1] * p.scale) ** -2.0 for p in parameters])
    linear, drop = projected.fitted(weak, lower=np.array([p.lower for p in parameters]))
    values = nonlinear | {p.name: 0.0 for p in effect.parameters(recorded) if p.linear}
    values |= dict(zip((p.name for p in parameters), linear.tolist(), strict=True))
    return _Point(values, columns, linear @ columns, drop, projected, weak)


def _slopes(
    problem: Problem, recorded: RecordedMotion, effect: Effect, at: _Point, moving: Sequence[EffectParameter]
) -> Array:
    """(d, R) whitened derivative of the response by the place of each non-linear parameter in its prior."""
    if not moving:
        return np.zeros((0, len(at.response)))
    here = effect.simulate(recorded, at.values)
    return problem.whiten(np.stack([slope_of(effect, recorded, at.values, p, here) for p in moving], axis=2))


def _stepped(
    problem: Problem,
    regression: WhitenedRegression,
    recorded: RecordedMotion,
    effect: Effect,
    at: _Point,
    moving: Sequence[EffectParameter],
    slopes: Array,
    damping: Damping,
    least: float,
) -> _Point | None:
    """A Levenberg-Marquardt step in all parameters, damped until the fit improves; None when it cannot."""
    count = len(at.columns)
    # The remainder after the present response; linear parameters count from their present values.
    rest = regression.with_target(regression.target - at.response).project(np.vstack([at.columns, slopes]))
    present = np.array([at.values[p.name] for p in acting_parameters(effect, recorded, at.values) if p.linear])
    mean = np.concatenate([-present, np.zeros(len(slopes))])
    promised = 0.5 * rest.fitted(np.concatenate([at.weak, np.ones(len(slopes))]), mean)[1]
    if 0.5 * at.drop + _HOPE * promised < least:
        return None
    for strength in damping.tries():
        held = strength * np.diag(rest.information)[count:]
        step = rest.fitted(np.concatenate([at.weak, held + 1e-9]), mean)[0][count:]
        values = {p.name: p.moved(at.values[p.name], float(s)) for p, s in zip(moving, step, strict=True)}
        trial = _linear(problem, regression, recorded, effect, {**at.values, **values})
        if trial.drop > at.drop:
            damping.eased(strength)
            return trial
    return None


def _evidence_gain(
    regression: WhitenedRegression, at: _Point, parameters: Sequence[EffectParameter], slopes: Array
) -> float:
    """Gain of log evidence: exact in the linear parameters, Laplace in the others, averaged over prior widths."""
    inside = [not p.at_bound(at.values[p.name]) for p in parameters if p.linear]
    if inside and not any(inside):
        return -np.inf
    linear = [p for p in parameters if p.linear and not p.at_bound(at.values[p.name])]
    count = len(linear)
    projected = at.projected
    if len(slopes) or count < len(inside):
        projected = regression.project(np.vstack([at.columns[inside], slopes]))
    inner = projected.pick(slice(0, count))
    scores = []
    for scale in PRIOR_SCALES[::-1] if count else (1.0,):
        precision = np.array([(scale * p.scale) ** -2.0 for p in linear])
        # With the weakest priors the square falls most; far from a gain that says enough.
        narrowing = inner.narrowing(precision) if count else 0.0
        hopeful = count and 0.5 * at.drop - narrowing > _HOPELESS
        won = inner.gain(precision) if hopeful else 0.5 * at.drop - narrowing
        across = projected.information[:count, count:]
        held = inner.information + np.diag(precision)
        own = projected.information[count:, count:] - (across.T @ np.linalg.solve(held, across) if count else 0.0)
        scores.append(won + flat_width(own))
    return float(np.logaddexp.reduce(scores) - np.log(len(scores)))


def discrete_prior(parameters: Iterable[EffectParameter]) -> float:
    """log prior probability of discrete values at their resolution, of the parameters that act."""
    discrete = [p for p in parameters if p.resolution and not p.linear]
    return sum(float(np.log(min(p.resolution / (p.high - p.low), 1.0))) for p in discrete)
