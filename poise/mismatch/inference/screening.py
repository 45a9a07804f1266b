"""Effects added one at a time to a model that is linearised at its values: which are worth a full fit."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from poise.mismatch.effects import Effect, Values
from poise.mismatch.inference.added_effect import EffectCandidate, refine, score_starts
from poise.mismatch.inference.coarse import thinned
from poise.mismatch.inference.evidence import WhitenedRegression
from poise.mismatch.inference.fitting import linearization_point
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.inference.time_limit import TimeLimit
from poise.mismatch.inference.unknown import FreeCurve
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array, Mask

_LOOK = 7
"""Steps of the screening."""
_REACH = 0.2
"""Share of the best candidate's gain below which another one is not fitted."""
_NEAR_LAW = 0.5
"""Share of the potential of an effect's best law below which another one of its laws is not fitted."""
_PIECE = 0.7
"""Share of the gain of a simple effect below which one that contains it is not fitted."""
THRESHOLD = 3.0
"""log evidence from which a hypothesis is refined."""


def beside(
    problem: Problem,
    parts: Sequence[FittedEffect],
    effects: Sequence[Effect],
    limit: TimeLimit,
    known: FittedEffect | None = None,
    least: float = THRESHOLD,
) -> list[EffectCandidate]:
    """Each effect added to some parts, at its most likely values; the most promising first.

    Slow effects are screened on averaged samples, fast ones at the full rate. The values of a `known` one are among the
    points from which its fit may start. Effects that cannot win `least` of log evidence are not refined.
    """
    full, rough = replace(problem, blocks=None), problem if problem.blocks else thinned(problem)
    slow = _screened(rough, parts, [effect for effect in effects if not effect.fast], limit, known, least)
    fast = _screened(full, parts, [effect for effect in effects if effect.fast], limit, known, least)
    return sorted((*slow, *fast), key=lambda each: -each.gain)


def _screened(
    problem: Problem,
    parts: Sequence[FittedEffect],
    effects: Sequence[Effect],
    limit: TimeLimit,
    known: FittedEffect | None,
    threshold: float,
) -> list[EffectCandidate]:
    """Each effect added to some parts at one rate, the most promising first.

    The score at its starting points bounds its gain; effects that cannot approach the best so far are not refined.
    """
    here = linearization_point(problem, parts)
    regression = here.regression
    few = _middles(here.recorded, problem)
    seen = []
    for effect in effects:
        # At the deadline, a known effect is still compared.
        own = known is not None and effect.name == known.effect.name
        if limit.over() and not own:
            continue
        # States have many columns; the middles of the blocks suffice for them.
        recorded = few if isinstance(effect, FreeCurve) else here.recorded
        starts = _starts(effect, recorded, here.residual)
        if known is not None and own:
            nonlinear = {p.name: known.values[p.name] for p in effect.parameters(recorded) if not p.linear}
            starts = chain(starts, [nonlinear])
        best = score_starts(problem, regression, recorded, effect, starts)
        if best:
            seen.append(best)
    recorded = here.recorded
    found: list[EffectCandidate] = []
    top = 0.0
    # Effects whose starting points say nothing come last, and before them those that contain others: the gains of the
    # others then end their refinement early.
    for first, *others in sorted(seen, key=_turn):
        pieces = [_PIECE * other.gain for other in found if other.effect.name in first.effect.made_of]
        least = max(threshold, _REACH * top, *pieces)
        hopeful = (first.effect.rough or first.potential > least) and not limit.over()
        tried = [first]
        if hopeful:
            near = [each for each in others if first.effect.rough or each.potential >= _NEAR_LAW * first.potential]
            tried = [_refined(problem, regression, recorded, each, least) for each in (first, *near)]
        done = max((_possible(recorded, each) for each in tried), key=lambda each: each.gain)
        found.append(replace(done, visibility=first.visibility))
        top = max(top, done.gain)
    return sorted(found, key=lambda each: -each.gain)


def _turn(starts: Sequence[EffectCandidate]) -> tuple[bool, bool, float]:
    """When an effect is refined: the most promising first."""
    first = starts[0]
    return np.isinf(first.potential), bool(first.effect.made_of), -first.potential


def _refined(
    problem: Problem, regression: WhitenedRegression, recorded: RecordedMotion, at: EffectCandidate, least: float
) -> EffectCandidate:
    """An effect refined from a starting point."""
    nonlinear = {p.name: at.values[p.name] for p in at.effect.parameters(recorded) if not p.linear}
    if not nonlinear or isinstance(at.effect, FreeCurve):
        return at
    return refine(problem, regression, recorded, at.effect, nonlinear, _LOOK, least)


def _possible(recorded: RecordedMotion, found: EffectCandidate) -> EffectCandidate:
    """An effect; without hope of a gain where its values are impossible."""
    impossible = not isinstance(found.effect, FreeCurve) and found.effect.implausible(recorded, found.values)
    return replace(found, gain=-np.inf) if impossible else found


def _middles(recorded: RecordedMotion, problem: Problem) -> RecordedMotion:
    """The samples in the middles of the blocks."""
    if problem.blocks is None:
        return recorded
    middle = problem.blocks.middle(len(problem.seconds))
    return recorded.once(("middles", problem.signal, int(middle.sum())), lambda: _picked(recorded, problem, middle))


def _picked(recorded: RecordedMotion, problem: Problem, rows: Mask) -> RecordedMotion:
    """The samples of a mask (N,) of the signal; free curves need nothing but the motion."""
    if problem.signal == "wrench" or recorded.effort is None:
        return recorded.select(rows)
    return replace(recorded, effort=recorded.effort.select(rows))


def _starts(effect: Effect, recorded: RecordedMotion, residual: Array) -> Iterator[Values]:
    """Starting points; events are searched in each recording separately."""
    if effect.transfers or not recorded.begins:
        yield from effect.starts(recorded, residual)
        return
    for begin in (-np.inf, *recorded.begins):
        rows = recorded.recording_of(begin)
        yield from effect.starts(replace(recorded.select(rows), begins=()), residual[rows])
