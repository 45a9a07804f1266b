"""Which effects a recording speaks for: one, then two, then three, each against everything else that could be.

Hypotheses are compared by their evidence, each under the noise that suits it best (of those that came up on the way):
a slow residual may be coloured noise under one hypothesis and physics under the next. Effects are first tried beside
the present best model with the noise and the calibration linearised there; the promising ones are then fitted in full.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.effects import all_effects
from poise.mismatch.effects.base import Effect
from poise.mismatch.fitting import Candidate, Fit, fit, refine
from poise.mismatch.problem import Part, Problem
from poise.mismatch.world import World

Array = NDArray[np.float64]

PROMISING = 5
"""Candidates of a round that are fitted in full."""
REACH = 0.25
"""Share of the best candidate's gain below which another one is not fitted in full."""
MOST_PARTS = 3
THRESHOLD = 6.0
"""log evidence that an effect must win over the model without it."""
NEXT_THRESHOLD = 10.0
"""The same for a second and third effect."""


@dataclass
class Search:
    """What was tried, and how it came out.

    Args:
        problem: the signal; its noise is that of the nominal model.
        fits: best fit of every hypothesis, by the names of its effects.
        untestable: effects that this recording cannot show, and why.
    """

    problem: Problem
    fits: dict[tuple[str, ...], Fit] = field(default_factory=dict)
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
        reason = effect.untestable(problem.world) if effect.signal == problem.signal else "-"
        if not reason:
            effects.append(effect)
        elif effect.signal == problem.signal:
            state.untestable[effect.name] = reason
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
    return state, best


def _round(state: Search, best: Fit, effects: Sequence[Effect]) -> Fit | None:
    """The best model with one more effect, under the noise that suits it."""
    problem = _under(state.problem, best)
    candidates = screen(problem, best, effects)
    chosen = [c for c in candidates[:PROMISING] if c.gain > max(1.0, REACH * candidates[0].gain)]
    found = [fit(problem, (*best.parts, Part(c.effect, c.values))) for c in chosen]
    for each in found:
        state.offer(each)
    if not found:
        return None
    found.sort(key=lambda each: -each.log_evidence)
    # The noise that the best one leaves; all near it, and the model before, are judged under that too.
    quieter = problem.with_noise(problem.fitted_noise(left_over(problem, found[0])))
    top = [each for each in found if each.log_evidence > found[0].log_evidence - 30.0]
    again = [fit(quieter, each.parts, steps=2) for each in top]
    for each in (*again, fit(quieter, best.parts, steps=2)):
        state.offer(each)
    return max((state.fits[names(each)] for each in found), key=lambda each: each.log_evidence)


def screen(problem: Problem, best: Fit, effects: Sequence[Effect]) -> list[Candidate]:
    """Each effect beside the present best model, refined a little; the most promising first."""
    world = problem.compose(best.parts)[1]
    taken = {part.effect.name for part in best.parts}
    residual = left_over(problem, best)
    found = []
    for effect in effects:
        if effect.name not in taken:
            one = _beside(problem, best, world, effect, residual)
            if one is not None:
                found.append(one)
    return sorted(found, key=lambda each: -each.gain)


def _beside(problem: Problem, best: Fit, world: World, effect: Effect, residual: Array) -> Candidate | None:
    tried = [refine(problem, best.frame, world, effect, start, steps=0) for start in effect.starts(world, residual)]
    if not tried:
        return None
    first = max(tried, key=lambda each: each.gain)
    nonlinear = {p.name: first.values[p.name] for p in effect.parameters(world) if not p.linear}
    return refine(problem, best.frame, world, effect, nonlinear) if nonlinear else first


def left_over(problem: Problem, found: Fit) -> Array:
    """(N, C) residual of a fit, calibration errors taken out."""
    return np.asarray(problem.measured - problem.predicted(problem.world) - found.response - found.calibrated)


def _under(problem: Problem, best: Fit) -> Problem:
    """The problem with the noise that the best fit leaves."""
    return problem.with_noise(problem.fitted_noise(left_over(problem, best))) if best.parts else problem
