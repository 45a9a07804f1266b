"""How sure an answer is: probabilities of effects, the rivals each beat, and those it cannot be told from."""

import math
from dataclasses import dataclass

from poise.mismatch.search import Search

TEMPERATURE = 2.0
"""log evidences are divided by this before they become probabilities: models are never quite right. Chosen by hand;
docs/concealed.md says how far the probabilities are from being calibrated."""
PER_EFFECT = math.log(30.0)
"""log prior odds against one effect more, of about thirty that there are."""
MOST_SURE = 0.995
ALIKE = 3.0
"""Difference of log evidence (tempered) below which two hypotheses are not told apart."""
WORTH_TELLING = 0.001

Names = tuple[str, ...]


@dataclass(frozen=True)
class Belief:
    """What is thought of one effect of the answer.

    Args:
        probability: that it is there, with the others as they are.
        rivals: (name, probability) of what could stand in its place, the likeliest first.
        alike: names that the recording cannot tell it from.
    """

    probability: float
    rivals: tuple[tuple[str, float], ...]
    alike: tuple[str, ...]


def beliefs(state: Search, answer: Names) -> dict[str, Belief]:
    """A belief for each effect of an answer."""
    evidence = _evidences(state)
    top = evidence[answer]
    weight = {names: math.exp(min(value - top, 50.0)) for names, value in evidence.items()}
    total = sum(weight.values())
    found = {}
    for name in answer:
        without = tuple(other for other in answer if other != name)
        instead = {
            _stranger(names, without): value
            for names, value in weight.items()
            if len(names) == len(answer) and set(without) < set(names) and names != answer
        }
        share = sum(value for names, value in weight.items() if name in names) / total
        rivals = sorted(((rival, value / total) for rival, value in instead.items()), key=lambda pair: -pair[1])
        alike = tuple(rival for rival, value in rivals if value * total > math.exp(-ALIKE))
        told = tuple((rival, value) for rival, value in rivals if value > WORTH_TELLING)[:5]
        found[name] = Belief(min(share, MOST_SURE), told, alike)
    return found


def sureness_of_none(state: Search) -> float:
    """Probability that nothing of the library is there."""
    evidence = _evidences(state)
    top = max(evidence.values())
    total = sum(math.exp(value - top) for value in evidence.values())
    return min(math.exp(evidence[()] - top) / total, MOST_SURE)


def _evidences(state: Search) -> dict[Names, float]:
    """Tempered log posteriors, up to a constant, of all hypotheses that were tried, in full or in passing."""
    found = {names: each.log_evidence for names, each in state.fits.items()}
    for (names, effect), gain in state.gains.items():
        key = tuple(sorted((*names, effect)))
        if names in found and key not in state.fits:
            found[key] = state.fits[names].log_evidence + gain
    return {names: value / TEMPERATURE - PER_EFFECT * len(names) / TEMPERATURE for names, value in found.items()}


def _stranger(names: Names, known: Names) -> str:
    return next(name for name in names if name not in known)
