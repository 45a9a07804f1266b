"""Fitting hypotheses: effects with their exact responses, by Gauss-Newton steps on all parameters at once.

Linear parameters have normal priors about zero, as wide as one of `PRIOR_SCALES` times the typical size. Non-linear
parameters move in the unit interval of their priors. The evidence is exact in the linear parameters and the calibration
errors, and by Laplace's method in the non-linear ones (MacKay 1992, "Bayesian interpolation").
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammainccinv

from poise.mismatch.effects import Effect, EffectParameter, Values
from poise.mismatch.inference.damping import Damping
from poise.mismatch.inference.evidence import ProjectedColumns, WhitenedRegression, flat_width, laplace_evidence
from poise.mismatch.inference.linearised import (
    PRIOR_SCALES,
    Linearised,
    acting_columns,
    acting_parameters,
    columns_of,
    linearised,
    slope_of,
)
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array, Mask

_MOST_STEPS = 12
_HOPE = 5.0
"""Largest ratio of the gain of a step to the prediction of the linear model."""
_HOPELESS = -15.0
"""log evidence of an effect below which a bound suffices."""
_SETTLED = 0.1
"""Decrease of the square at which a fit has converged."""
_NEARLY = 2.0
"""Decrease of the square below which the calibration is not linearised again."""

_CLOCK_MARGIN = 1.1
"""Tolerances that a delay must exceed: unlike an exact shift, the clock's calibration column is of first order."""
_CHANCE = 0.00135
"""Probability that a normal deviate exceeds three sigma on one side."""


@dataclass(frozen=True, eq=False)
class HypothesisFit:
    """A hypothesis at its most likely parameters.

    Args:
        parts: effects with values.
        log_evidence: comparable between fits of one problem, for any noise.
        square: least weighted square of residual and priors.
        regression: calibration and the linearised parts about the fit, with priors; the basis of further effects.
        response: (N, C) of the parts.
        calibrated: (N, C) of the calibration errors.
        covariance: of each part's parameters, in the order of `Effect.parameters`.
        linear: (k,) columns of the regression that belong to calibration errors or linear parameters.
    """

    parts: tuple[FittedEffect, ...]
    log_evidence: float
    square: float
    regression: WhitenedRegression
    response: Array
    calibrated: Array
    covariance: tuple[Array, ...]
    linear: Mask


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
        start: non-linear values.
        steps: at the most.
        least: gain of interest: the search ends as soon as it is out of reach.
    """
    parameters = acting_parameters(effect, recorded, start)
    moving = [p for p in parameters if not (p.linear or p.choice or p.resolution)]
    at = _linear(problem, regression, recorded, effect, dict(start))
    damping = Damping()
    for _ in range(steps if moving else 0):
        slopes = _slopes(problem, recorded, effect, at, moving)
        moved = _stepped(problem, regression, recorded, effect, at, moving, slopes, damping, least)
        if moved is None:
            break
        settled = moved.drop - at.drop < _SETTLED
        at = moved
        if settled:
            break
    slopes = _slopes(problem, recorded, effect, at, moving)
    gain = _evidence_gain(regression, at, parameters, slopes) + _chosen(parameters)
    return EffectCandidate(effect, at.values, gain, at.drop, gain)


def score_starts(
    problem: Problem, regression: WhitenedRegression, recorded: RecordedMotion, effect: Effect, starts: Iterable[Values]
) -> EffectCandidate | None:
    """One effect beside a regression at the best of some starting points; its potential is the gain beyond chance."""
    tried = (_linear(problem, regression, recorded, effect, dict(start)) for start in starts)
    at = max(tried, key=lambda each: each.drop, default=None)
    if at is None:
        return None
    parameters = acting_parameters(effect, recorded, at.values)
    free = sum(not p.choice for p in parameters)
    slopes = np.zeros((0, len(at.response)))
    gain = _evidence_gain(regression, at, parameters, slopes) + _chosen(parameters)
    moving = any(not p.linear for p in parameters)
    typical = np.array([p.scale for p in parameters if p.linear])
    visibility = float(np.sqrt(np.max(np.diag(at.projected.information) * typical**2))) if len(typical) else np.inf
    # Without linear parameters the value at a starting point says nothing; only the slopes do.
    potential = np.inf if not len(typical) else 0.5 * (at.drop - free) if moving else gain
    return EffectCandidate(effect, at.values, gain, at.drop, potential, visibility)


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


def _chosen(parameters: Iterable[EffectParameter]) -> float:
    """log prior probability of discrete values at their resolution, of the parameters that act."""
    discrete = [p for p in parameters if p.resolution and not p.linear]
    return sum(float(np.log(min(p.resolution / (p.high - p.low), 1.0))) for p in discrete)


@dataclass(frozen=True, eq=False)
class LinearizationPoint:
    """The model about which one more effect is tried.

    Args:
        regression: calibration and the present parts, linearised.
        recorded: after the present parts.
        residual: (N, C) measured minus all that.
    """

    regression: WhitenedRegression
    recorded: RecordedMotion
    residual: Array


def linearization_point(problem: Problem, parts: Sequence[FittedEffect]) -> LinearizationPoint:
    """The linearization about some parts at their values."""
    about = linearised(problem, tuple(parts), None)
    about = about.inside() or about
    calibrated = problem.calibrated(problem.groups(about.whole, parts), about.calibration.coefficients())
    return LinearizationPoint(
        about.regression(1.0),
        about.whole,
        problem.unexplained(problem.predicted(about.whole) + calibrated),
    )


def fit(problem: Problem, parts: Sequence[FittedEffect], steps: int = 12) -> HypothesisFit:
    """The most likely parameters of several effects at once, the calibration linearised about their prediction.

    Args:
        problem: the signal.
        parts: effects with values to start from; none: the nominal model with its calibration errors.
        steps: at the most.
    """
    current = linearised(problem, tuple(parts), None)
    for _ in range(2 if parts else 0):
        settled = _settled(problem, current, steps)
        if current.square - settled.square < _NEARLY:
            current = settled
            break
        # The response of the calibration changes slightly with the predicted wrench.
        current = linearised(problem, settled.parts, None)
    return _finished(problem, current)


def _settled(problem: Problem, at: Linearised, steps: int) -> Linearised:
    """Levenberg-Marquardt steps in all parameters, with fixed columns of the calibration."""
    damping = Damping()
    for _ in range(steps):
        moved = _all_stepped(problem, at, damping)
        if moved is None:
            return at
        if at.square - moved.square < _SETTLED:
            return replace(moved, columns=at.columns)
        at = replace(moved, columns=columns_of(problem, moved.parts, moved.inputs))
    return at


def _all_stepped(problem: Problem, at: Linearised, damping: Damping) -> Linearised | None:
    precision, mean = at.priors(PRIOR_SCALES[-1])
    own = at.parameters()
    projected = at.calibration.project(at.columns)
    lower = np.array([p.lower - at.parts[i].values[p.name] if p.positive else -np.inf for i, p in own])
    for strength in damping.tries():
        held = strength * np.diag(projected.information) + 1e-9
        step, _ = projected.fitted(np.where(precision > 0, precision, held), mean, lower)
        values = [dict(part.values) for part in at.parts]
        for (i, p), s in zip(own, step, strict=True):
            old = values[i][p.name]
            values[i][p.name] = old + float(s) if p.linear else p.moved(old, float(s))
        parts = tuple(FittedEffect(part.effect, new) for part, new in zip(at.parts, values, strict=True))
        moved = linearised(problem, parts, at.calibration, slopes=False)
        if moved.square < at.square:
            damping.eased(strength)
            return moved
    return None


def exceeds_tolerance(problem: Problem, parts: Sequence[FittedEffect], effect: Effect) -> bool:
    """Whether an effect lies outside the tolerances that it widens by three sigma; true where it widens none.

    A delay must exceed the tolerance of the clock: what else a filter does may be an error of the measured motion.
    So must what a skew makes late by the end. A turn of the load must exceed the tolerance of the sensor's rotation.
    At the edge of the tolerances, noise alone lowers the square by as many degrees of freedom as half the parameters.

    Args:
        problem: the signal.
        parts: as fitted.
        effect: of one of them.
    """
    values = next(part.values for part in parts if part.effect is effect)
    if effect.delay:
        # Beside a filter the clock may be early, beside an offset of the clock it may not.
        least = _CLOCK_MARGIN * problem.model.tolerance.clock_offset * (1.0 if effect.widens == "clock" else 2.0)
        if abs(values[effect.delay]) < least:
            return False
    tolerance = problem.model.tolerance
    # Within its tolerance, the attitude of the sensor may be off by as much in each posture.
    bounds = ((effect.late, _CLOCK_MARGIN * tolerance.clock_offset), (effect.turn, tolerance.sensor_rotation))
    for quantity, least in bounds:
        if quantity and abs(effect.derived(problem.recorded, values)[quantity][0]) < least:
            return False
    if not effect.widens:
        return True
    squares, counts = [], []
    for kept in (parts, [part for part in parts if part.effect is not effect]):
        about = linearised(problem, tuple(kept), None)
        squares.append(about.regression(PRIOR_SCALES[-1]).square)
        counts.append(len(about.columns))
    # Of chi square with half as many degrees of freedom.
    return bool(squares[1] - squares[0] > 2.0 * gammainccinv((counts[0] - counts[1] + 1) / 4, _CHANCE))


def _finished(problem: Problem, at: Linearised) -> HypothesisFit:
    inside = at.inside()
    at = inside or at
    own = at.parameters()
    linear = np.array([p.linear for _, p in own], dtype=bool)
    calibration = at.calibration.project(at.columns)
    scores = []
    for scale in PRIOR_SCALES if linear.any() else (1.0,):
        precision, mean = at.priors(scale)
        scores.append(laplace_evidence(at.calibration, calibration, precision, mean, linear))
    best = int(np.argmax(scores))
    known = sum(
        _chosen(acting_parameters(part.effect, recorded, part.values))
        for part, recorded in zip(at.parts, at.inputs, strict=True)
    )
    evidence = float(np.logaddexp.reduce(scores) - np.log(len(scores))) + known - problem.log_scale
    if inside is None:
        evidence = -np.inf
    whole = at.regression(PRIOR_SCALES[best])
    response = problem.predicted(at.whole) - problem.predicted(problem.recorded)
    groups = problem.groups(at.whole, at.parts)
    calibrated = problem.calibrated(groups, at.calibration.coefficients())
    straight = np.concatenate([np.ones(whole.count - len(linear), dtype=bool), linear])
    return HypothesisFit(at.parts, evidence, at.square, whole, response, calibrated, at.covariances(whole), straight)
