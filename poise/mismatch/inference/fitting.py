"""Fitting hypotheses: effects with their exact responses, by Gauss-Newton steps on all parameters at once.

Linear parameters have normal priors about zero, as wide as one of `PRIOR_SCALES` times the typical size. Non-linear
parameters move in the unit interval of their priors. The evidence is exact in the linear parameters and the calibration
errors, and by Laplace's method in the non-linear ones (MacKay 1992, "Bayesian interpolation").
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv

from poise.mismatch.effects import Effect, effect_named
from poise.mismatch.inference.added_effect import discrete_prior
from poise.mismatch.inference.damping import SETTLED, Damping
from poise.mismatch.inference.evidence import WhitenedRegression, laplace_evidence
from poise.mismatch.inference.linearised import (
    PRIOR_SCALES,
    Linearised,
    acting_parameters,
    columns_of,
    continuous_parameters,
    linearised,
)
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array, Mask

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
        rows: of each part, the rows of the regression that belong to these parameters; -1: not fitted.
        linear: (k,) columns of the regression that belong to calibration errors or linear parameters.
    """

    parts: tuple[FittedEffect, ...]
    log_evidence: float
    square: float
    regression: WhitenedRegression
    response: Array
    calibrated: Array
    covariance: tuple[Array, ...]
    rows: tuple[NDArray[np.intp], ...]
    linear: Mask

    def covariance_with_misfit(self) -> list[Array]:
        """`covariance`, as wide as the residual shows, see `WhitenedRegression.spread`."""
        wider = self.regression.spread / np.sqrt(np.diag(self.regression.covariance()))
        factors = [np.where(row >= 0, wider[row], 1.0) for row in self.rows]
        return [each * np.outer(factor, factor) for each, factor in zip(self.covariance, factors, strict=True)]


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
        if at.square - moved.square < SETTLED:
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
    A likelier cause in the place of the effect (`Effect.commoner`) must leave the data outside the tolerances, too.
    At the edge of the tolerances, noise alone lowers the square by as many degrees of freedom as half the parameters.

    Args:
        problem: the signal.
        parts: as fitted.
        effect: of one of them.
    """
    own = next(part for part in parts if part.effect is effect)
    values = own.values
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
    if not effect.widens and not effect.commoner:
        return True
    rest = [part for part in parts if part.effect is not effect]
    known = {part.effect.name for part in rest}
    likelier = [each for name in effect.commoner if name not in known and (each := effect_named(name)) is not None]
    instead = [FittedEffect(each, {}).carried(problem.recorded) for each in likelier]
    about = (linearised(problem, tuple(kept), None) for kept in (parts, [*rest, *instead]))
    here, without = (each.regression(PRIOR_SCALES[-1]).square for each in about)
    # Of chi square with half as many degrees of freedom.
    freedom = len(continuous_parameters(own, problem.recorded))
    return bool(without - here > 2.0 * gammainccinv((freedom + 1) / 4, _CHANCE))


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
        discrete_prior(acting_parameters(part.effect, recorded, part.values))
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
    rows = at.rows()
    covariance = at.covariances(whole, rows)
    return HypothesisFit(at.parts, evidence, at.square, whole, response, calibrated, covariance, rows, straight)
