"""Confidence of an answer: probabilities of effects, their rivals, and indistinguishable effects."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from scipy.special import expit

from poise.mismatch.effects import effect_named
from poise.mismatch.inference import (
    EQUAL_EVIDENCE,
    LOOKALIKE,
    EffectCandidate,
    EffectProof,
    FittedEffect,
    FreeCurve,
    ProvenModel,
    Variation,
    alike,
)

_MISFIT = 4.0
"""Weight of the misfit that an answer leaves in the comparison with its rivals: chosen on development cases."""
_VARIES = 0.01
"""Share of its own log evidence by which the laws of an effect may be wrong without another cause: those of real
friction, rotors and links vary by up to that (benchmarks.real)."""
_LAW = 0.05
"""Share of what a free curve explains that the law of an effect may lack without another cause: the curve then has the
shape of the law (viscous friction of benchmarks.real lacks 2 %; imitations of other causes lacked 4 to 7 %)."""
_BETTER_CURVE, _BETTER_BEYOND = 1.5, 1e-9
"""Factor of the evidence by which a free curve is better than a name in its place, and odds of the name beside it
(`rival_odds`), so that the curve is an equal rival: right names of development cases had at most 1.1 times less
evidence than the best curve (`benchmarks.foreign`)."""
_AS_LIKELY = 0.1
"""Odds from which a free curve over a state is as likely as an event of free course: of 39 true events of development
cases none had odds above 0.001, of five false ones all had more than 0.4."""
_MATERIAL_VARIATION = 0.9
"""Relative evidence of a variation (see `BeliefBasis`) from which it is reported."""
WEIGHTS = (-1.6, 1.0, 1.3, -3.85, 1.85)
"""Of `belief_probability`; fitted on cases of two generators by `benchmarks.concealed.calibrate`, but with a steeper
slope: names of low evidence are rare in answers, and likelier where the truth holds nothing (healthy recordings). The
third lies between the fits to older and to newer answers (see docs/mismatch_method.md)."""
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
        varies_with: what it would have to vary with to explain the recording, which is against it; "" if it need not.
    """

    probability: float
    rivals: tuple[tuple[str, float], ...]
    alike: tuple[str, ...]
    basis: "BeliefBasis | None"
    varies_with: str = ""


@dataclass(frozen=True)
class BeliefBasis:
    """The evidence for a name and against it.

    Args:
        evidence: `support` of its proof, see `EffectProof`.
        rivals: sum of the odds of other effects and free curves in its place: 1 for one that does as well.
        equals: sum of the odds of rivals that count in full: as likely by rule, or as simple.
        once: it is an event: it does not act again in another recording.
        varies: log evidence for an effect that varies over the recording, relative to what right effects may have.
    """

    evidence: float
    rivals: float
    equals: float
    once: bool
    varies: float = 0.0

    @property
    def probability(self) -> float:
        """That the name is true."""
        return belief_probability(self, WEIGHTS)


def belief_probability(basis: BeliefBasis, weights: Sequence[float]) -> float:
    """Probability of a name: the chance that its evidence is no error of a model, shared with its rivals.

    Args:
        basis: what speaks for the name and against it.
        weights: two of a logistic function of the log evidence; the log odds that a name has beside a rival that does
            as well (the search preferred it); those of an unknown cause that acts once, beside an event;
            what `varies` takes from the log odds of the logistic function.
    """
    slope = weights[0] + weights[1] * math.log(max(basis.evidence, 1.0)) - weights[4] * basis.varies
    rivals = basis.rivals * math.exp(-weights[2]) + basis.equals + basis.once * math.exp(weights[3])
    return min(float(expit(slope)) / (1.0 + rivals), MAX_PROBABILITY)


def beliefs(
    model: ProvenModel,
    instead: Sequence[Mapping[str, EffectCandidate]],
    varied: Sequence[Variation],
    misfit: float,
    equals: Sequence[Collection[str]],
    suspects: frozenset[str] = frozenset(),
) -> tuple[EffectBelief, ...]:
    """A belief for each effect of an answer.

    An event with a free course follows anything brief. Where an unknown effect stays beside it, that effect alone is as
    likely: it counts as an equal rival. So does a similar effect of the same answer where the residual is within the
    noise without the name: one of the two may explain what both share.

    Args:
        model: the answer, with its proofs; effects that lack a proof are no rivals.
        instead: for each part, what the effects of the library win in its place.
        varied: the strongest variation of each part.
        misfit: share of the error of the nominal model that the answer leaves above the noise.
        equals: for each part, the twins of the effect (see `Effect.twins`) and the unknown effect that may stand in the
            place of an event of free course.
        suspects: effects that another signal of the recording supports without proof, where that one stays unexplained:
            those that are confused with a name are as likely.
    """
    parts = zip(model.fit.parts, model.proofs, instead, varied, equals, strict=True)
    return tuple(_belief(model, *each, misfit, suspects) for each in parts)


def _belief(
    model: ProvenModel,
    part: FittedEffect,
    proof: EffectProof,
    candidates: Mapping[str, EffectCandidate],
    variation: Variation,
    equals: Collection[str],
    misfit: float,
    suspects: frozenset[str],
) -> EffectBelief:
    """Of one effect of an answer; see `beliefs`."""
    lost = set(model.dropped) - {other.effect.name for other in model.fit.parts}
    name = part.effect.name
    own = candidates[name].gain if name in candidates else -math.inf
    own = own if math.isfinite(own) else proof.evidence
    gains = {rival: each.gain for rival, each in candidates.items() if rival != name and rival not in lost}
    lacks = LOOKALIKE if part.effect.layer == "friction" else 0.0
    odds = {rival: rival_odds(own, gain, misfit, lacks) for rival, gain in gains.items()}
    # Free curves over similar states are one explanation, an effect outside the library: the best one counts.
    curve = max((rival for rival in odds if effect_named(rival) is None), key=gains.__getitem__, default="")
    odds = {rival: value for rival, value in odds.items() if rival == curve or effect_named(rival) is not None}
    if curve and name in candidates:
        missing = 1.0 - candidates[name].drop / max(candidates[curve].drop, 1e-9)
        odds[curve] *= min(max(missing / _LAW, 0.0), 1.0)
    ruled = set(equals) | _equal_in_answer(model, part, proof) | suspects & set(part.effect.confused_with)
    ruled |= {curve} if curve and _far_better(gains[curve], own, misfit) else set()
    ruled |= _lasting_curve(part, candidates, gains, own, misfit)
    if any(effect_named(rival) is None for rival in ruled):
        odds.pop(curve, None)
    odds |= dict.fromkeys(ruled, 1.0)
    same = {rival for rival in odds if rival in candidates and candidates[rival].same}
    odds |= dict.fromkeys(same, 1.0)
    larger = _larger(part, odds, gains, own) - set(equals)
    against = {rival: value for rival, value in odds.items() if rival not in larger}
    # Of rivals that do as well, the search takes the simplest. A delay and a filter have as many parameters.
    full = ruled | same | {rival for rival in against if not part.effect.preferred or _both_delay(rival, part)}
    compared = {rival: value for rival, value in against.items() if rival not in full}
    basis = BeliefBasis(
        proof.support,
        sum(compared.values()),
        sum(against.values()) - sum(compared.values()),
        not part.effect.transfers,
        variation.gain / (EQUAL_EVIDENCE + (_VARIES + part.effect.lacks) * max(proof.evidence, 0.0)),
    )
    counts = against | {rival: value * math.exp(-WEIGHTS[2]) for rival, value in compared.items()}
    reported = sorted(((rival, basis.probability * value) for rival, value in counts.items()), key=_second)
    equal = sorted((rival for rival, value in odds.items() if value > _ALIKE), key=odds.__getitem__)
    kept = tuple(pair for pair in reversed(reported) if pair[1] > _LEAST_REPORTED)
    against_it = variation.state if basis.varies > _MATERIAL_VARIATION else ""
    return EffectBelief(basis.probability, kept[:5], tuple(reversed(equal)), basis, against_it)


def _larger(part: FittedEffect, odds: Mapping[str, float], gains: Mapping[str, float], own: float) -> set[str]:
    """Effects that contain a name and do hardly better: no rivals, unless they are as likely by rule."""
    more = own + LOOKALIKE * max(own, 0.0)
    containing = {rival for rival in odds if _contains(rival, part.effect.name)}
    return {rival for rival in containing if gains.get(rival, own) <= more}


def _equal_in_answer(model: ProvenModel, part: FittedEffect, proof: EffectProof) -> set[str]:
    """Similar effects of the same answer that are as likely as a name, see `beliefs`."""
    others = [other.effect for other in model.fit.parts if other.effect.name != part.effect.name]
    return {other.name for other in others if proof.within_noise and alike(other, part.effect)}


def rival_odds(own: float, rival: float, misfit: float, lacks: float = 0.0) -> float:
    """Odds of a rival relative to a name, at most 1.

    A likelihood assumes that one of the hypotheses is exact. None is: what the best answer leaves unexplained shows by
    how much responses are wrong, and rivals that differ from it by as little are as likely (a power likelihood; Miller
    and Dunson 2019, "Robust Bayesian inference via coarsening"). The error of a response is a share of it: a rival that
    explains hardly anything is not excused by what the name leaves.

    Args:
        own, rival: log evidence of the named effect, and of another one in its place.
        misfit: share of the held-out error that the answer leaves, see `beliefs`.
        lacks: share of its evidence by which the law of the rival may be wrong in any case, as friction's.
    """
    return math.exp(min(rival - own, 0.0) / (EQUAL_EVIDENCE + (lacks + _MISFIT * misfit) * max(rival, 0.0)))


def _far_better(curve: float, own: float, misfit: float) -> bool:
    """Whether a free curve wins far more evidence than a name, even where the answer leaves an error."""
    return curve > _BETTER_CURVE * own and rival_odds(curve, own, misfit) < _BETTER_BEYOND


def _lasting_curve(
    part: FittedEffect, candidates: Mapping[str, EffectCandidate], gains: Mapping[str, float], own: float, misfit: float
) -> set[str]:
    """The free curve over a state that explains as much as an event of free course: it acts whenever the state returns.

    Either follows anything, and the event acts only once.
    """
    if not part.effect.free(part.values):
        return set()
    curves = {name: each.effect for name, each in candidates.items() if name in gains}
    lasting = [name for name, effect in curves.items() if isinstance(effect, FreeCurve) and not effect.of_time]
    return {name for name in lasting if rival_odds(own, gains[name], misfit, LOOKALIKE) > _AS_LIKELY}


def _second(pair: tuple[str, float]) -> float:
    return pair[1]


def _both_delay(rival: str, part: FittedEffect) -> bool:
    effect = effect_named(rival)
    return effect is not None and bool(effect.delay and part.effect.delay)


def _contains(name: str, piece: str) -> bool:
    effect = effect_named(name)
    return effect is not None and piece in effect.made_of
