"""Confidence of an answer: probabilities of effects, their rivals, and indistinguishable effects."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from poise.mismatch.effects import effect_named
from poise.mismatch.inference import (
    EQUAL_EVIDENCE,
    EffectCandidate,
    EffectProof,
    FittedEffect,
    HypothesisSearch,
    ProvenModel,
    alike,
)

_MISFIT = 4.0
"""Weight of the misfit that an answer leaves in the comparison with its rivals: chosen on development cases."""
_NONE_TEMPERATURE = 2.0
"""Divisor of log evidences in the comparison of the nominal model with models that have effects: no model is exact."""
_PER_EFFECT = math.log(30.0)
"""log prior odds against one effect more, of about thirty that there are."""
_WEIGHTS = (-1.4, 0.8)
"""Of `BeliefBasis.terms` in the log odds that the library holds the truth: fitted on development cases by
`benchmarks.concealed.calibrate`."""
MAX_PROBABILITY = 0.995
_ALIKE = 0.22
"""Odds relative to the name from which a rival is called indistinguishable."""
_LEAST_REPORTED = 0.001

Names = tuple[str, ...]


@dataclass(frozen=True)
class EffectBelief:
    """The confidence in one effect of the answer.

    Args:
        probability: of the effect: the chance that the library holds the truth, shared with its rivals.
        rivals: (name, probability) of effects that could replace it, the likeliest first.
        alike: names of effects that the recording cannot distinguish from it.
        basis: of the probability; None where the readings alone show the effect.
    """

    probability: float
    rivals: tuple[tuple[str, float], ...]
    alike: tuple[str, ...]
    basis: "BeliefBasis | None"


@dataclass(frozen=True)
class BeliefBasis:
    """The evidence for a name and against it.

    Args:
        evidence: `support` of its proof, see `EffectProof`.
        rivals: sum of the odds of other effects and free curves in its place: 1 for one that does as well.
    """

    evidence: float
    rivals: float

    @property
    def terms(self) -> tuple[float, ...]:
        """The regressors of the log odds that the library holds the truth."""
        return 1.0, math.log(max(self.evidence, 1.0))

    @property
    def probability(self) -> float:
        """That the name is true: the library holds the truth, and the rivals share it."""
        odds = sum(weight * term for weight, term in zip(_WEIGHTS, self.terms, strict=True))
        return min(1.0 / (1.0 + math.exp(-odds)) / (1.0 + self.rivals), MAX_PROBABILITY)


def beliefs(
    model: ProvenModel, instead: Sequence[Mapping[str, EffectCandidate]], misfit: float, beside: str = ""
) -> tuple[EffectBelief, ...]:
    """A belief for each effect of an answer.

    An event with a free course follows anything brief. Where an unknown effect stays beside it, that effect alone is as
    likely: it counts as an equal rival. So does a similar effect of the same answer where the residual is within the
    noise without the name: one of the two may explain what both share.

    Args:
        model: the answer, with its proofs; effects that lack a proof are no rivals.
        instead: for each part, what the effects of the library win in its place.
        misfit: share of the error of the nominal model that the answer leaves above the noise.
        beside: state on which the unknown part of the answer depends; "" without one.
    """
    lost = set(model.dropped) - {part.effect.name for part in model.fit.parts}
    found = []
    for part, proof, candidates in zip(model.fit.parts, model.proofs, instead, strict=True):
        name = part.effect.name
        own = candidates[name].gain if name in candidates else -math.inf
        own = own if math.isfinite(own) else proof.evidence
        gains = {rival: each.gain for rival, each in candidates.items() if rival != name and rival not in lost}
        odds = {rival: rival_odds(own, gain, misfit) for rival, gain in gains.items()}
        # Free curves over similar states are one explanation, an effect outside the library: the best one counts.
        curve = max((rival for rival in odds if effect_named(rival) is None), key=odds.__getitem__, default="")
        odds = {rival: value for rival, value in odds.items() if rival == curve or effect_named(rival) is not None}
        odds = _with_equals(odds, model, part, proof, beside)
        # An effect that contains the name and does no better is no rival.
        against = {
            rival: value for rival, value in odds.items() if gains.get(rival, own) > own or not _contains(rival, name)
        }
        basis = BeliefBasis(proof.support, sum(against.values()))
        reported = sorted(((rival, basis.probability * value) for rival, value in against.items()), key=_second)
        equal = sorted((rival for rival, value in odds.items() if value > _ALIKE), key=odds.__getitem__)
        kept = tuple(pair for pair in reversed(reported) if pair[1] > _LEAST_REPORTED)
        found.append(EffectBelief(basis.probability, kept[:5], tuple(reversed(equal)), basis))
    return tuple(found)


def _with_equals(
    odds: dict[str, float], model: ProvenModel, part: FittedEffect, proof: EffectProof, beside: str
) -> dict[str, float]:
    """The odds of rivals, with those that are equal to a name by rule, see `beliefs`."""
    if beside and part.effect.free_course:
        odds = {rival: value for rival, value in odds.items() if effect_named(rival)} | {f"unknown:{beside}": 1.0}
    others = [other.effect for other in model.fit.parts if other.effect.name != part.effect.name]
    similar = [other.name for other in others if proof.within_noise and alike(other, part.effect)]
    return odds | dict.fromkeys(similar, 1.0)


def rival_odds(own: float, rival: float, misfit: float) -> float:
    """Odds of a rival relative to a name, at most 1.

    A likelihood assumes that one of the hypotheses is exact. None is: what the best answer leaves unexplained shows by
    how much responses are wrong, and rivals that differ from it by as little are as likely (a power likelihood; Miller
    and Dunson 2019, "Robust Bayesian inference via coarsening"). The error of a response is a share of it: a rival that
    explains hardly anything is not excused by what the name leaves.

    Args:
        own, rival: log evidence of the named effect, and of another one in its place.
        misfit: share of the held-out error that the answer leaves, see `beliefs`.
    """
    return math.exp(min(rival - own, 0.0) / (EQUAL_EVIDENCE + _MISFIT * misfit * max(rival, 0.0)))


def _second(pair: tuple[str, float]) -> float:
    return pair[1]


def _contains(name: str, piece: str) -> bool:
    effect = effect_named(name)
    return effect is not None and piece in effect.made_of


def probability_of_none(state: HypothesisSearch) -> float:
    """Probability that nothing of the library is there; effects that were not tried keep their prior odds."""
    found = _evidences(state)
    found |= {(name,): found[()] for name in state.late}
    evidence = {names: value / _NONE_TEMPERATURE - _PER_EFFECT * len(names) for names, value in found.items()}
    top = max(evidence.values())
    total = sum(math.exp(value - top) for value in evidence.values())
    return min(math.exp(evidence[()] - top) / total, MAX_PROBABILITY)


def _evidences(state: HypothesisSearch) -> dict[Names, float]:
    """log evidence, up to a constant, of all hypotheses that were tried, fitted in full or screened."""
    found = {names: each.log_evidence for names, each in state.fits.items()}
    for (names, effect), gain in state.gains.items():
        key = tuple(sorted((*names, effect)))
        if names in found and key not in state.fits:
            found[key] = state.fits[names].log_evidence + gain
    return found
