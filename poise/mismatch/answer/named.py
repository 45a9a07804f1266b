"""The named effects of an answer: parameters with errors, belief and proof."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from poise.mismatch.answer.belief import MAX_PROBABILITY, EffectBelief, beliefs
from poise.mismatch.effects import Effect, Values, effect_named, joint_unit
from poise.mismatch.inference import (
    NEAR_SHARE,
    Dependence,
    EffectCandidate,
    EffectProof,
    FittedEffect,
    HypothesisFit,
    Problem,
    ProvenModel,
    Variation,
)
from poise.mismatch.reading import ModelEffect
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_SIZE = 2.0
"""Sigmas by which the sizes of an effect together differ from nothing at least."""
_EXACT = 1e-12
"""Least variance of sizes together, in units of their own; smaller ones are rounding."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """A number with its one-sigma error, NaN when unknown."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """One effect of the answer; without a proof where the readings alone show it.

    `alternatives` are effects that explain nearly as much in its place, and the log evidence that each of them lacks.
    """

    effect: Effect
    values: Values
    covariance: Array
    belief: EffectBelief
    parameters: dict[str, Quantity]
    windows: tuple[tuple[float, float], ...]
    sentence: str
    proof: EffectProof | None
    alternatives: tuple[tuple[ModelEffect, float], ...] = ()

    @property
    def component(self) -> ModelEffect:
        """As it joins a model."""
        return ModelEffect(self.effect.name, dict(self.values), self.covariance)


def named_effects(
    problem: Problem,
    best: HypothesisFit,
    model: ProvenModel,
    instead: Sequence[Mapping[str, EffectCandidate]],
    varied: Sequence[Variation],
    misfit: float,
    beside: str,
    suspects: frozenset[str] = frozenset(),
) -> list[NamedEffect]:
    """The effects of the best fit; `instead`, `varied`, `misfit` and `suspects` as in `beliefs`.

    `beside` is the state on which the unknown part of the answer depends, "" without one.
    """
    inputs = problem.compose(best.parts)[0]
    acting = list(zip(best.parts, inputs, strict=True))
    alike = [equals(part, recorded, beside) for part, recorded in acting]
    confidence = beliefs(model, instead, varied, misfit, alike, suspects)
    found = [
        NamedEffect(
            part.effect,
            part.values,
            covariance,
            belief,
            quantities(part, recorded, covariance),
            part.effect.windows(recorded, part.values),
            part.effect.sentence(recorded, part.values),
            proof,
            _near(part, others, problem.recorded),
        )
        for (part, recorded), covariance, belief, proof, others in zip(
            acting, covariances(best, inputs), confidence, model.proofs, instead, strict=True
        )
        if not isinstance(part.effect, Dependence)
    ]
    return sorted(found, key=lambda each: -each.belief.probability)


def covariances(best: HypothesisFit, inputs: Sequence[RecordedMotion]) -> list[Array]:
    """Of the parameters of each part: what the residual shows, and the errors of its law."""
    found = []
    for part, recorded, covariance in zip(best.parts, inputs, best.covariance_with_misfit(), strict=True):
        of_law = [p.law_sigma(part.values[p.name]) for p in part.effect.parameters(recorded)]
        found.append(covariance + np.diag(np.square(of_law)))
    return found


def within_errors(part: FittedEffect, recorded: RecordedMotion, covariance: Array) -> bool:
    """Whether the sizes that an effect reports are all nothing within their errors; False where it reports none.

    Args:
        part: as fitted.
        recorded: on which it acts.
        covariance: of its parameters, see `HypothesisFit.covariance_with_misfit`.
    """
    parameters = part.effect.parameters(recorded)
    # What friction hides is its asymmetry; moments, which a payload hides, are reported as its centre of mass.
    hidden = bool(part.effect.of_joint)
    sizes = [index for index, p in enumerate(parameters) if p.linear and not (hidden and p.hidden)]
    deviations = np.sqrt(np.diag(covariance)[sizes])
    known = deviations > 0.0
    values = np.array([part.values[parameters[index].name] for index in sizes])
    if not known.any():
        return bool(len(sizes)) and not values.any()
    chosen = np.asarray(sizes)[known]
    inner = covariance[np.ix_(chosen, chosen)] / np.outer(deviations[known], deviations[known])
    # Sizes that are not known one by one, as of a load on one axis, are known together: small variances count.
    variances, directions = np.linalg.eigh(inner)
    along = directions.T @ (values[known] / deviations[known])
    return bool(np.sum(along**2 / np.maximum(variances, _EXACT)) < _SIZE**2)


def equals(part: FittedEffect, recorded: RecordedMotion, beside: str) -> set[str]:
    """Rivals that are as likely as an effect by rule, see `beliefs`; `beside` as in `named_effects`."""
    imitated = part.effect.imitated(recorded, part.values)
    state = imitated or beside
    follows = part.effect.free(part.values) or (imitated and beside)
    unknown = {f"unknown:{state}"} if state and follows else set()
    return unknown | set(part.effect.twins(recorded, part.values))


def _near(
    part: FittedEffect, instead: Mapping[str, EffectCandidate], recorded: RecordedMotion
) -> tuple[tuple[ModelEffect, float], ...]:
    """Effects that win nearly as much in the place of one, see `NamedEffect`."""
    own = instead[part.effect.name].gain if part.effect.name in instead else np.nan
    found = []
    for name, each in instead.items():
        if name != part.effect.name and effect_named(name) is not None and own - each.gain < NEAR_SHARE * own:
            count = len(each.effect.parameters(recorded))
            component = ModelEffect(name, dict(each.values), np.zeros((count, count)))
            found.append((component, max(own - each.gain, 0.0)))
    return tuple(found)


def shown_effects(problem: Problem, best: HypothesisFit, library: Sequence[Effect]) -> list[NamedEffect]:
    """Effects that the readings show beside the prediction of the best fit, and that the model does not state so."""
    expected = problem.predicted(problem.recorded) + best.response + best.calibrated
    recorded = problem.with_prediction(problem.recorded, expected)
    found = []
    for effect in library:
        values = effect.detected(recorded) if effect.signal == problem.signal and effect.direct else None
        stated = problem.model.effect(effect.name)
        if values is not None and (stated is None or effect.differs(values, stated.values)):
            parameters = effect.parameters(problem.recorded)
            covariance = np.diag([p.resolution**2 / 12.0 for p in parameters])
            reported = quantities(FittedEffect(effect, values), problem.recorded, covariance)
            sure, sentence = EffectBelief(MAX_PROBABILITY, (), (), None), effect.sentence(problem.recorded, values)
            found.append(NamedEffect(effect, values, covariance, sure, reported, (), sentence, None))
    return found


def quantities(part: FittedEffect, recorded: RecordedMotion, covariance: Array) -> dict[str, Quantity]:
    """The reported parameters with one-sigma errors, to first order for derived ones."""
    effect, values = part.effect, dict(part.values)
    parameters = effect.parameters(recorded)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unused = effect.inert(values)

    def unit(name: str, turning: str) -> str:
        return joint_unit(recorded, turning, name, values) if effect.layer == "friction" else turning

    reported = {
        p.name: Quantity(float(values[p.name]), float(s), unit(p.name, p.unit))
        for p, s in zip(parameters, sigma, strict=True)
        if not p.hidden and p.name not in unused
    }
    derived = effect.derived(recorded, values)
    if not derived:
        return reported
    slopes = np.zeros((len(derived), len(parameters)))
    for k, (p, s) in enumerate(zip(parameters, sigma.tolist(), strict=True)):
        if s > 0:
            moved = effect.derived(recorded, {**values, p.name: values[p.name] + 0.01 * s})
            # A quantity that is reported for some values only, as the end of what ends, may be missing there.
            slopes[:, k] = [(moved.get(name, here)[0] - here[0]) / (0.01 * s) for name, here in derived.items()]
    spread = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0))
    for (name, (value, turning)), std in zip(derived.items(), spread.tolist(), strict=True):
        reported[name] = Quantity(value, std, unit(name, turning))
    return reported
