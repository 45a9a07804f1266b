"""Which effects a recording speaks for: one, then two, then three, each against everything else that could be.

Hypotheses are compared by their evidence, each under the noise that suits it best (of those that came up on the way):
a slow residual may be coloured noise under one hypothesis and physics under the next. Effects are first tried beside
the present best model with the noise and the calibration linearised there; the promising ones are then fitted in full.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.coarse import thinned
from poise.mismatch.effects import all_effects
from poise.mismatch.effects.base import Effect
from poise.mismatch.fitting import Candidate, Fit, fit, ground, refine
from poise.mismatch.problem import Part, Problem
from poise.mismatch.unknown import Dependence, dependences

Array = NDArray[np.float64]

PROMISING = 5
"""Candidates of a round that are fitted in full."""
REACH = 0.25
"""Share of the best candidate's gain below which another one is not fitted in full."""
MOST_PARTS = 3
THRESHOLD = 4.0
"""log evidence that an effect must win over the model without it."""
NEXT_THRESHOLD = 8.0
"""The same for a second and third effect."""


@dataclass
class Search:
    """What was tried, and how it came out.

    Args:
        problem: the signal; its noise is that of the nominal model.
        fits: best fit of every hypothesis, by the names of its effects.
        gains: log evidence that an effect was seen to add to a hypothesis, where it was not fitted in full.
        untestable: effects that this recording cannot show, and why.
    """

    problem: Problem
    fits: dict[tuple[str, ...], Fit] = field(default_factory=dict)
    gains: dict[tuple[tuple[str, ...], str], float] = field(default_factory=dict)
    untestable: dict[str, str] = field(default_factory=dict)

    def offer(self, found: Fit) -> None:
        """Keep a fit when its hypothesis had none as good."""
        key = names(found)
        if key not in self.fits or self.fits[key].log_evidence < found.log_evidence:
            self.fits[key] = found


def names(found: Fit) -> tuple[str, ...]:
    """The effects of a fit, in alphabetical order."""
    return tuple(sorted(part.effect.name for part in found.parts))


def search(problem: Problem, library: Sequence[Effect] | None = None) -> tuple[Search, Fit]:
    """Find the effects that earn their place.

    Returns:
        Everything that was tried, and the best fit: that of the nominal model when nothing earned a place.
    """
    state = Search(problem)
    effects = []
    for effect in all_effects() if library is None else library:
        if effect.signal != problem.signal:
            continue
        reason = effect.untestable(problem.world) or _identified(problem, effect)
        if not reason:
            effects.append(effect)
        else:
            state.untestable[effect.name] = reason
    if problem.signal == "wrench":
        effects += dependences(problem.world)
    best = fit(problem, ())
    state.offer(best)
    for parts in range(MOST_PARTS):
        found = _round(state, best, effects)
        if found is None:
            break
        won = found.log_evidence - state.fits[names(best)].log_evidence
        if won < (THRESHOLD if parts == 0 else NEXT_THRESHOLD):
            break
        best = found
    return state, _pruned(state, best)


def _identified(problem: Problem, effect: Effect) -> str:
    known = effect.widens == "payload" and problem.model.payload_identified
    return "the payload was identified from this recording: give it in model.yaml" if known else ""


def _pruned(state: Search, best: Fit) -> Fit:
    """Without parts that later ones made needless."""
    while len(best.parts) > 1:
        problem = _under(state.problem, best)
        shorter = []
        for part in best.parts:
            rest = fit(problem, [other for other in best.parts if other is not part])
            state.offer(rest)
            shorter.append(state.fits[names(rest)])
        top = max(shorter, key=lambda each: each.log_evidence)
        if best.log_evidence - top.log_evidence > NEXT_THRESHOLD:
            break
        best = top
    return best


def _round(state: Search, best: Fit, effects: Sequence[Effect]) -> Fit | None:
    """The best model with one more effect, under the noise that suits it."""
    problem = _under(state.problem, best)
    least = (NEXT_THRESHOLD if best.parts else THRESHOLD) - 5.0
    candidates = screen(state, problem, best, effects, least)
    chosen = [c for c in candidates[:PROMISING] if c.gain > max(least, REACH * candidates[0].gain)]
    found = [fit(problem, (*best.parts, Part(c.effect, c.values))) for c in chosen]
    for each in found:
        state.offer(each)
    if not found:
        return None
    found.sort(key=lambda each: -each.log_evidence)
    # The noise that the best one leaves; all near it, and the model before, are judged under that too.
    quieter = problem.with_noise(problem.fitted_noise(left_over(problem, found[0])))
    top = [each for each in found if each.log_evidence > found[0].log_evidence - 30.0]
    for each in (*top, best):
        state.offer(fit(quieter, each.parts))
    return max((state.fits[names(each)] for each in found), key=lambda each: each.log_evidence)


def screen(state: Search, problem: Problem, best: Fit, effects: Sequence[Effect], least: float) -> list[Candidate]:
    """Each effect beside the present best model; the most promising first, fitted at the full rate.

    Effects are first tried on a thinned recording; those that gain `least` or more, and are in reach of the best, are
    then tried in full.
    """
    taken = {part.effect.name for part in best.parts}
    whole = problem.compose(best.parts)[1]
    rough = thinned(problem, whole)
    slow = [effect for effect in effects if effect.name not in taken and not effect.fast]
    looked = _beside(rough, best.parts, slow, least) if rough is not problem else []
    reach = max(least, 0.5 * REACH * max((each.gain for each in looked), default=0.0))
    hopeful = [each.effect for each in _few_unknown(looked)[: 2 * PROMISING] if each.gain > reach]
    fast = [effect for effect in effects if effect.name not in taken and (effect.fast or rough is problem)]
    found = _beside(problem, best.parts, [*hopeful, *fast], least)
    for each in (*looked, *found):
        state.gains[names(best), each.effect.name] = each.gain
    return found


def _few_unknown(candidates: list[Candidate]) -> list[Candidate]:
    """Without the pseudo-effects behind the first two: states resemble one another."""
    unknown = [each for each in candidates if isinstance(each.effect, Dependence)]
    return [each for each in candidates if each not in unknown[2:]]


def _beside(problem: Problem, parts: Sequence[Part], effects: Sequence[Effect], least: float) -> list[Candidate]:
    """Each effect beside some parts, at its most likely values; the most promising first."""
    here = ground(problem, parts)
    frame, world = here.frame, here.world
    found = []
    for effect in effects:
        tried = [refine(problem, frame, world, effect, start, steps=0) for start in effect.starts(world, here.residual)]
        if not tried:
            continue
        best = max(tried, key=lambda each: each.gain)
        nonlinear = {p.name: best.values[p.name] for p in effect.parameters(world) if not p.linear}
        found.append(refine(problem, frame, world, effect, nonlinear, least=least) if nonlinear else best)
    return sorted(found, key=lambda each: -each.gain)


def left_over(problem: Problem, found: Fit) -> Array:
    """(N, C) residual of a fit, calibration errors taken out."""
    return np.asarray(problem.measured - problem.predicted(problem.world) - found.response - found.calibrated)


def _under(problem: Problem, best: Fit) -> Problem:
    """The problem with the noise that the best fit leaves."""
    return problem.with_noise(problem.fitted_noise(left_over(problem, best))) if best.parts else problem
