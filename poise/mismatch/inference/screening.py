"""Effects added one at a time to a model that is linearised at its values: which are worth a full fit."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from poise.mismatch.effects import Effect, Values
from poise.mismatch.inference.coarse import thinned
from poise.mismatch.inference.fitting import EffectCandidate, linearization_point, refine, score_starts
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.inference.time_limit import TimeLimit
from poise.mismatch.inference.unknown import FreeCurve
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array, Mask

_LOOK = 7
"""Steps of the screening."""
_REACH = 0.2
"""Share of the best candidate's gain below which another one is not fitted."""
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
        if best is not None:
            seen.append(best)
    recorded = here.recorded
    found: list[EffectCandidate] = []
    top = 0.0
    # Effects whose starting points say nothing come last, and before them those that contain others: the gains of the
    # others then end their refinement early.
    for each in sorted(seen, key=lambda each: (np.isinf(each.potential), bool(each.effect.made_of), -each.potential)):
        pieces = [_PIECE * other.gain for other in found if other.effect.name in each.effect.made_of]
        least = max(threshold, _REACH * top, *pieces)
        done = each
        if not isinstance(each.effect, FreeCurve):
            nonlinear = {p.name: each.values[p.name] for p in each.effect.parameters(recorded) if not p.linear}
            promising = each.effect.rough or each.potential > least
            if nonlinear and promising and not limit.over():
                done = refine(problem, regression, recorded, each.effect, nonlinear, _LOOK, least)
            if each.effect.implausible(recorded, done.values):
                done = replace(done, gain=-np.inf)
        found.append(replace(done, visibility=each.visibility))
        top = max(top, done.gain)
    return sorted(found, key=lambda each: -each.gain)


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
