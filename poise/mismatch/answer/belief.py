"""Confidence of an answer: probabilities of effects, their rivals, and indistinguishable effects."""

import math
from collections import Counter
from dataclasses import dataclass

from poise.mismatch.effects import effect_named
from poise.mismatch.inference import HypothesisSearch, ProvenModel

_TEMPERATURE = 4.0
"""Divisor of log evidences in the comparison of rivals: no model is exact, and widths of priors are typical ones."""
_NONE_TEMPERATURE = 2.0
"""The same, in the comparison of the nominal model with models that have more effects."""
_PER_EFFECT = math.log(30.0)
"""log prior odds against one effect more, of about thirty that there are."""
_WEIGHTS = (-0.74, 0.47, -0.23, -0.13, -0.64, -2.69)
"""Of `BeliefBasis.terms` in the log odds that a name is true: fitted on answers to cases of two generators by
`benchmarks.concealed.calibrate`."""
_IMITATES = 0.1
"""Energy that stays unexplained where an effect acts, in units of its own, from which it counts against the name."""
MAX_PROBABILITY = 0.995
_ALIKE = 1.5
"""Difference of log evidence (tempered) below which two hypotheses are indistinguishable."""
_LEAST_REPORTED = 0.001

Names = tuple[str, ...]


@dataclass(frozen=True)
class EffectBelief:
    """The confidence in one effect of the answer.

    Args:
        probability: of the effect: the rate at which comparable names were right (Platt's scaling).
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
        evidence, share, rest: `support`, `share` and `rest` of its proof, see `EffectProof`.
        rivals: sum over the hypotheses that replace it by another effect: 1 for one that does as well.
        parts: of the answer, named or not.
        beside_unknown: the residual contains an effect that no name explains.
    """

    evidence: float
    share: float
    rest: float
    rivals: float
    parts: int
    beside_unknown: bool

    @property
    def terms(self) -> tuple[float, ...]:
        """The regressors of the log odds: other effects and unknown ones question a name that removes little error.

        What stays unexplained where the effect acts could imitate it.
        """
        little = -math.log(max(self.share, 1e-3))
        evidence, rivals = math.log(max(self.evidence, 1.0)), math.log1p(self.rivals)
        left = math.log1p(self.rest / _IMITATES)
        return 1.0, evidence, little * self.beside_unknown, little * (self.parts > 1), left, rivals

    @property
    def probability(self) -> float:
        """That the name is true; rivals that do as well are as likely."""
        odds = sum(weight * term for weight, term in zip(_WEIGHTS, self.terms, strict=True))
        return min(1.0 / (1.0 + math.exp(-odds)), 1.0 / (1.0 + self.rivals), MAX_PROBABILITY)


def beliefs(
    state: HypothesisSearch, answer: Names, model: ProvenModel, *, beside_unknown: bool
) -> tuple[EffectBelief, ...]:
    """A belief for each effect of an answer.

    Args:
        state: all hypotheses that were tried.
        answer: the effects of the best hypothesis.
        model: it, with its proofs; hypotheses with effects that lack a proof are no rivals.
        beside_unknown: the residual contains an effect that no name explains.
    """
    dropped = set(model.dropped) - set(answer)
    raw = {names: value for names, value in _evidences(state).items() if not dropped & set(names)}
    weight = {names: math.exp(min(value - raw[answer], 0.0) / _TEMPERATURE) for names, value in raw.items()}
    found = []
    for part, proof in zip(model.fit.parts, model.proofs, strict=True):
        name = part.effect.name
        without = Counter(answer) - Counter([name])
        instead = {
            next(iter((Counter(names) - without).elements())): value
            for names, value in weight.items()
            if len(names) == len(answer) and not without - Counter(names) and names != answer
        }
        as_well = sum(value for rival, value in instead.items() if name not in _contained((rival,)))
        basis = BeliefBasis(proof.support, proof.share, proof.rest, as_well, len(answer), beside_unknown)
        lacking = sum(value for names, value in weight.items() if names.count(name) < answer.count(name))
        others = {rival: (1.0 - basis.probability) * value / max(lacking, 1e-300) for rival, value in instead.items()}
        reported = sorted(((rival, p) for rival, p in others.items() if p > _LEAST_REPORTED), key=lambda pair: -pair[1])
        alike = sorted((rival for rival, value in instead.items() if value > math.exp(-_ALIKE)), key=others.__getitem__)
        found.append(EffectBelief(basis.probability, tuple(reported[:5]), tuple(reversed(alike)), basis))
    return tuple(found)


def probability_of_none(state: HypothesisSearch) -> float:
    """Probability that nothing of the library is there."""
    evidence = {
        names: value / _NONE_TEMPERATURE - _PER_EFFECT * len(names) for names, value in _evidences(state).items()
    }
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


def _contained(names: Names) -> set[str]:
    """The effects of a hypothesis, and those that they contain."""
    effects = [effect_named(name) for name in names]
    return {*names, *(piece for effect in effects if effect is not None for piece in effect.made_of)}
