"""Other effects in the place of each effect of an answer: its rivals, and better answers among them.

A search adds one effect at a time. An effect that came early was never compared with others beside those that came
later. Each one is therefore compared with the whole library in its place, under the noise that the answer leaves.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from poise.mismatch.effects import Effect
from poise.mismatch.inference.added_effect import EffectCandidate
from poise.mismatch.inference.fitting import HypothesisFit, exceeds_tolerance, fit
from poise.mismatch.inference.hypotheses import HypothesisSearch, alike
from poise.mismatch.inference.linearised import acting_parameters
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.inference.screening import beside
from poise.mismatch.inference.unknown import FreeCurve

EQUAL_EVIDENCE = 4.0
"""Difference of log evidence up to which two explanations do equally well: widths of priors are typical ones."""
LOOKALIKE = 0.005
"""Share of all the evidence won by which an effect must exceed one that it is confused with: no model is exact, and a
similar effect with more parameters fits the remaining details."""
NEAR, NEAR_SHARE = 20.0, 0.15
"""log evidence within which hypotheses are compared in full, and the same as a share of the evidence won: the noise of
the previous model contains what they explain, so that their differences are small under it."""
_CANDIDATE = 0.3
"""Share of the evidence of a single effect, under the noise of the nominal model, below which another is no rival."""
_SAME = 0.01
"""Energy of the difference of two responses, relative to theirs, below which they are the same (whitened, without what
calibration errors explain; where both win as much, relative to all that the effect explains)."""
_STEPS = 4
_TRIED = 3
"""Better effects that are tried in the place of one."""
_MOST, _SMOOTHED = 0.5, 0.15
"""Share of the smoothing that a delay leaves, below which it explains most of it; least smoothing that shows."""


def replacements(state: HypothesisSearch, found: HypothesisFit) -> tuple[dict[str, EffectCandidate], ...]:
    """For each part of an answer, what each effect of the library wins in its place, itself included.

    At the deadline, effects that are confused with it count as equal to it: they were not compared in full.
    """
    coloured = state.under(found)
    problem = coloured.weighed()
    out = []
    for part in found.parts:
        others = [other for other in found.parts if other is not part]
        beside_it = {other.effect.name for other in others}
        # One of its kind may be beside it.
        taken = beside_it.union(*(other.effect.made_of for other in others)) - {part.effect.name}
        # An effect is never named beside one that contains it.
        free = [each for each in state.library if each.name not in taken and not beside_it & set(each.made_of)]
        free = [each for each in free if others or _near(state, part, each)]
        candidates = {each.effect.name: each for each in beside(problem, others, free, state.limit, part)}
        own = candidates.get(part.effect.name)
        if own is not None and own.gain < NEAR and problem is not coloured:
            # Least squares in time, which hardly shows the effect, does not distinguish it from others either.
            candidates = {each.effect.name: each for each in beside(coloured, others, free, state.limit, part)}
            own = candidates.get(part.effect.name)
        if part.effect.delay and own is not None and not state.limit.over():
            candidates |= _delays(state, problem, others, own, candidates)
        if own is not None and state.limit.over():
            unsure = [each for each in free if alike(each, part.effect) and each is not part.effect]
            candidates |= {each.name: replace(own, effect=each) for each in unsure}
        elif own is not None:
            candidates = _marked(problem, others, own, candidates)
        out.append(candidates)
    return tuple(out)


def _marked(
    problem: Problem, others: Sequence[FittedEffect], own: EffectCandidate, candidates: dict[str, EffectCandidate]
) -> dict[str, EffectCandidate]:
    """The candidates, with a mark on those whose response is that of the effect itself, and that are as simple.

    Two effects with one response differ in evidence by what their parameters cost; how well either fits the details of
    a recording says nothing.
    """
    own = candidates[own.effect.name]
    slack, most = EQUAL_EVIDENCE + LOOKALIKE * max(own.gain, 0.0), _cost(own) + EQUAL_EVIDENCE
    near = [each for each in candidates.values() if each is not own and not isinstance(each.effect, FreeCurve)]
    near = [each for each in near if abs(each.gain - own.gain) < slack and _cost(each) < most]
    near = [each for each in near if own.effect.name not in each.effect.commoner]
    if not near:
        return candidates
    recorded = problem.compose(others)[1]
    regression = problem.regression(others, recorded)
    response = own.effect.simulate(recorded, own.values)
    same = {}
    for each in near:
        if each.effect.delay and own.effect.delay:  # these were compared in full
            equal = abs(each.gain - own.gain) < EQUAL_EVIDENCE
        else:
            apart = each.effect.simulate(recorded, each.values) - response
            # Errors inside the tolerances that explain the difference do not distinguish them either.
            left, whole = np.diag(regression.project(problem.whiten(np.stack([apart, response], axis=2))).information)
            # Of an effect that exceeds a tolerance, errors inside the tolerances explain most.
            whole = max(whole, own.drop) if abs(each.gain - own.gain) < EQUAL_EVIDENCE else whole
            equal = bool(left < _SAME * whole)
        if equal:
            same[each.effect.name] = replace(each, same=True)
    return candidates | same


def _delays(
    state: HypothesisSearch,
    problem: Problem,
    others: Sequence[FittedEffect],
    own: EffectCandidate,
    candidates: Mapping[str, EffectCandidate],
) -> dict[str, EffectCandidate]:
    """Delays in the place of another one, compared in full: the smoothing in the calibration is as late as each."""
    least = max(own.gain - max(NEAR, NEAR_SHARE * own.gain), 0.0)
    delays = {name: each for name, each in candidates.items() if each.effect.delay and each.gain > least}
    delays[own.effect.name] = own
    if len(delays) == 1:
        return {}
    fits = {
        name: _fitted(state, problem, (*others, FittedEffect(each.effect, each.values)))
        for name, each in delays.items()
    }
    here = fits[own.effect.name]
    if not np.isfinite(here.log_evidence):
        return {}
    left = {name: _smoothing(problem, each) for name, each in fits.items()}
    out = {}
    for name, each in delays.items():
        # A filter is named where it explains most of the smoothing, and a delay where as much is left with a filter.
        less = _explains(left[name], left[own.effect.name]) - _explains(left[own.effect.name], left[name])
        gain = own.gain + fits[name].log_evidence - here.log_evidence + 2.0 * EQUAL_EVIDENCE * less
        out[name] = replace(each, gain=gain)
    return out


def _explains(left: float, other: float) -> int:
    """1 for a delay that leaves little of the smoothing that another one leaves, else 0."""
    return int(other > _SMOOTHED and left < _MOST * other)


def _smoothing(problem: Problem, found: HypothesisFit) -> float:
    """Size of the smoothing in the calibration errors beside a fit."""
    groups = problem.groups(problem.compose(found.parts)[1], found.parts)
    blurs = np.concatenate([np.full(int(group.seen.sum()), group.name == "blur") for group in groups])
    return float(np.linalg.norm(found.regression.coefficients()[: len(blurs)][blurs]))


def _near(state: HypothesisSearch, part: FittedEffect, other: Effect) -> bool:
    """Whether an effect won enough when the search began to be compared again; all, where the search gave no gains."""
    own, gain = (state.gains.get(((), name)) for name in (part.effect.name, other.name))
    return own is None or (gain is not None and gain >= _CANDIDATE * own)


def improved(
    state: HypothesisSearch, found: HypothesisFit, instead: tuple[Mapping[str, EffectCandidate], ...]
) -> HypothesisFit | None:
    """The answer with one effect in the place of one or two others, where it does better, or as well and is simpler.

    Returns:
        None where every effect is at its place.
    """
    problem, now = state.under(found), None
    places = (
        _single(problem, found, instead),
        _pairs(problem, found, instead),
        _alike_pairs(state, problem, found),
        _curves(state, problem, found, instead),
    )
    for replaced, best, slack in itertools.chain(*places):
        kept = tuple(part for part in found.parts if part not in replaced)
        key = tuple(sorted((*(part.effect.name for part in kept), best.effect.name)))
        if key in state.replaced:
            continue
        state.replaced.add(key)
        now = now or _fitted(state, problem, found.parts)
        tried = _fitted(state, problem, (*kept, FittedEffect(best.effect, best.values)))
        pressed = stopped_at_an_end(problem, tried) and not stopped_at_an_end(problem, now)
        good = tried.log_evidence > now.log_evidence - slack and not pressed
        if good and exceeds_tolerance(problem, tried.parts, best.effect):
            return tried
    return None


def _single(
    problem: Problem, found: HypothesisFit, instead: tuple[Mapping[str, EffectCandidate], ...]
) -> Iterator[tuple[tuple[FittedEffect, ...], EffectCandidate, float]]:
    """Each effect of an answer with those that are simpler or better in its place, and how much worse they may be."""
    for part, candidates in zip(found.parts, instead, strict=True):
        own = candidates.get(part.effect.name)
        if own is not None and not isinstance(part.effect, FreeCurve):
            for each in _simpler(problem, own, candidates):
                yield (part,), each, _slack(own.effect, each.effect, own.gain)


def _pairs(
    problem: Problem, found: HypothesisFit, instead: tuple[Mapping[str, EffectCandidate], ...]
) -> Iterator[tuple[tuple[FittedEffect, ...], EffectCandidate, float]]:
    """Each two effects of an answer with those that do as well in the place of either: one cause is simpler than two.

    A search that adds one effect at a time may explain a cause by two that have fewer parameters each. One that
    contains either of them must do better than both.
    """
    for (first, of_first), (second, of_second) in itertools.combinations(zip(found.parts, instead, strict=True), 2):
        pair = {first.effect.name, second.effect.name}
        good = _as_good(first, of_first), _as_good(second, of_second)
        both = [of_first[name] for name in good[0] & good[1] - pair]
        both = [each for each in both if not pair & set(each.effect.made_of)]
        for each in sorted(both, key=lambda one: _size(problem, one))[:_TRIED]:
            yield (first, second), each, EQUAL_EVIDENCE
        # One that contains an effect of the pair has not been compared in the place of the other.
        either = [*(of_first[name] for name in good[0]), *(of_second[name] for name in good[1])]
        for each in either:
            if len(pair & set(each.effect.made_of)) == 1:
                yield (first, second), each, 0.0


def _alike_pairs(
    state: HypothesisSearch, problem: Problem, found: HypothesisFit
) -> Iterator[tuple[tuple[FittedEffect, ...], EffectCandidate, float]]:
    """Each two effects that are confused with each other, with one that either is confused with in the place of both.

    Beside either of them it explains little: two swings in two directions hide a soft grasp.
    """
    for pair in itertools.combinations(found.parts, 2):
        if not alike(pair[0].effect, pair[1].effect):
            continue
        rest = [other for other in found.parts if other not in pair]
        names_of_pair = {part.effect.name for part in pair}
        free = [each for each in _free(state, rest) if each.name not in names_of_pair]
        free = [each for each in free if any(alike(each, part.effect) for part in pair)]
        for each in beside(problem.weighed(), rest, free, state.limit)[:_TRIED]:
            yield pair, each, EQUAL_EVIDENCE


def _curves(
    state: HypothesisSearch,
    problem: Problem,
    found: HypothesisFit,
    instead: tuple[Mapping[str, EffectCandidate], ...],
) -> Iterator[tuple[tuple[FittedEffect, ...], EffectCandidate, float]]:
    """The free curves of an answer with effects of the library in the place of all of them."""
    curves = tuple(part for part in found.parts if isinstance(part.effect, FreeCurve))
    if not curves:
        return
    rest = [other for other in found.parts if other not in curves]
    if len(curves) == 1:
        candidates = list(instead[found.parts.index(curves[0])].values())
    else:
        candidates = beside(problem.weighed(), rest, _free(state, rest), state.limit)
    named = [each for each in candidates if not isinstance(each.effect, FreeCurve) and each.gain > 0.0]
    for each in sorted(named, key=lambda one: -one.gain)[:_TRIED]:
        yield curves, each, 0.0


def _free(state: HypothesisSearch, rest: Sequence[FittedEffect]) -> list[Effect]:
    """The effects of the library that are no part of the rest of an answer, nor of an effect in it."""
    taken = {other.effect.name for other in rest}.union(*(other.effect.made_of for other in rest))
    return [each for each in state.library if each.name not in taken and not isinstance(each, FreeCurve)]


def _as_good(part: FittedEffect, candidates: Mapping[str, EffectCandidate]) -> set[str]:
    """Effects of the library that win about as much as a part in its place, or more; none for a free curve."""
    own = candidates.get(part.effect.name)
    if own is None or isinstance(part.effect, FreeCurve):
        return set()
    least = own.gain - EQUAL_EVIDENCE
    return {name for name, each in candidates.items() if each.gain > least and not isinstance(each.effect, FreeCurve)}


def _size(problem: Problem, each: EffectCandidate) -> tuple[bool, int, float]:
    """The order of candidates: general ones last, then by the number of parameters, then the best first."""
    parameters, inert = each.effect.parameters(problem.recorded), each.effect.inert(each.values)
    return each.effect.general, sum(not p.choice and p.name not in inert for p in parameters), -each.gain


def _cost(each: EffectCandidate) -> float:
    """log evidence that its parameters cost: an effect with many, or with unlikely values, loses more."""
    return 0.5 * each.drop - each.gain


def _simpler(
    problem: Problem, own: EffectCandidate, candidates: Mapping[str, EffectCandidate]
) -> list[EffectCandidate]:
    """Effects that win about as much as the best one, those with the fewest parameters first, up to the effect itself.

    One that contains it must win clearly more: no model is exact, and more parameters fit the remaining details. A
    general one counts as larger than all others.
    """
    name, more = own.effect.name, own.gain + EQUAL_EVIDENCE + LOOKALIKE * max(own.gain, 0.0)
    named = [each for each in candidates.values() if not isinstance(each.effect, FreeCurve)]
    named = [each for each in named if name not in each.effect.made_of or each.gain > more]
    top = max(each.gain for each in named)
    good = [each for each in named if each.gain > top - _slack(own.effect, each.effect, own.gain)]
    ranked = sorted(good, key=lambda each: _size(problem, each))
    least = next((_size(problem, each)[:2] for each in ranked if each is own), None)
    return [each for each in ranked if least is None or _size(problem, each)[:2] < least][:_TRIED]


def _slack(own: Effect, other: Effect, won: float) -> float:
    """log evidence by which another effect may be worse in the place of one: more for a piece of it, for it is simpler.

    Args:
        own, other: effects. won: log evidence of the one.
    """
    return EQUAL_EVIDENCE + (LOOKALIKE * max(won, 0.0) if other.name in own.made_of else 0.0)


def _fitted(state: HypothesisSearch, problem: Problem, parts: tuple[FittedEffect, ...]) -> HypothesisFit:
    if problem.signal == "wrench":
        return state.fitted(problem, parts, _STEPS)
    return state.fitted(problem, fit(problem.weighed(), parts, _STEPS).parts, 0)


def stopped_at_an_end(problem: Problem, found: HypothesisFit) -> bool:
    """Whether a parameter that acts was stopped at an end of its range: such an effect imitates another one.

    The ramps of joints do not count: without friction a joint has none.
    """
    inputs = problem.compose(found.parts)[0]
    return any(
        p.at_end(part.values[p.name]) and not p.choice and not (p.hidden and part.effect.of_joint)
        for part, recorded in zip(found.parts, inputs, strict=True)
        for p in acting_parameters(part.effect, recorded, part.values)
    )
