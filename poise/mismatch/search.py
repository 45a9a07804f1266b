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
    least = (NEXT_THRESHOLD if best.parts else THRESHOLD) - 5.0
    candidates = screen(problem, best, effects, least)
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


def screen(problem: Problem, best: Fit, effects: Sequence[Effect], least: float = 1.0) -> list[Candidate]:
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
    hopeful = [each.effect for each in looked[: 2 * PROMISING] if each.gain > reach]
    fast = [effect for effect in effects if effect.name not in taken and (effect.fast or rough is problem)]
    return _beside(problem, best.parts, [*hopeful, *fast], least)


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
