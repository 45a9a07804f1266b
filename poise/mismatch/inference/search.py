"""The search for the effects in a recording: one, then two, then three, each against all other hypotheses.

Hypotheses are compared by their evidence, each under the noise that suits it best (of the noise models found so far):
a slow residual may be coloured noise under one hypothesis and physics under the next. Effects are first tried beside
the present best model with the noise and the calibration linearised there; the promising ones are then fitted in full.
"""

from collections import Counter
from collections.abc import Collection, Sequence

import numpy as np

from poise.mismatch.effects import Effect, Values, all_effects
from poise.mismatch.inference.added_effect import EffectCandidate
from poise.mismatch.inference.effort_curves import effort_curves
from poise.mismatch.inference.fitting import HypothesisFit, exceeds_tolerance, fit
from poise.mismatch.inference.hypotheses import WARM_STEPS, HypothesisSearch, alike, names
from poise.mismatch.inference.linear_screen import screened
from poise.mismatch.inference.problem import FittedEffect, Problem
from poise.mismatch.inference.proof import LEAST_BESIDE
from poise.mismatch.inference.replacements import LOOKALIKE, NEAR, NEAR_SHARE
from poise.mismatch.inference.screening import THRESHOLD, beside
from poise.mismatch.inference.time_limit import TimeLimit
from poise.mismatch.inference.unknown import Dependence, FreeCurve, dependences
from poise.mismatch.reading import on_efforts
from poise.mismatch.recorded import RecordedMotion

_PROMISING = 3
"""Candidates of a round that are fitted."""
_STEPS = 4
"""Steps of a fit from the result of the screening."""
_BESIDE_CURVES = 0.5
"""Share of the gain of a free curve from which the best effect of the library is fitted as well."""
_VISIBLE = 3.0
"""Least response, in sigmas, of an effect of typical size that is testable."""
_MOST_PARTS, _FURTHER = 3, 0.3
"""Effects of an answer, and the share of the evidence that a further one needs from which its values are refined."""
_WIDER = 1.3
"""log evidence that an exceeded tolerance must win."""
_NEW_PHYSICS = 6.0
"""log evidence that physics missing in the nominal model must win."""
_UNKNOWN = 20.0
"""log evidence that a free curve over a state must win; it may also follow noise outside the noise model."""
_NEXT_THRESHOLD, _NEXT_MORE = 8.0, 5.0
"""log evidence to keep an effect, and what a second and third effect need in addition."""


def search(
    problem: Problem, library: Sequence[Effect] | None = None, limit: TimeLimit | None = None
) -> tuple[HypothesisSearch, HypothesisFit]:
    """Find the effects that the evidence supports.

    Returns:
        All hypotheses, and the best fit: that of the nominal model when no effect is supported.
    """
    state = HypothesisSearch(problem, limit=limit or TimeLimit())
    effects, state.untestable = testable(problem, library)
    if problem.signal == "wrench":
        effects += dependences(problem.recorded)
    state.library = (*effects, *(effort_curves() if problem.signal == "effort" else ()))
    best = fit(state.judging, ())
    state.offer(best)
    if problem.signal == "effort":
        return state, found_in_efforts(state)
    for number in range(_MOST_PARTS):
        if state.limit.over():
            break
        state.limit.passed(number / (_MOST_PARTS + 1))
        found = _round(state, best, effects)
        best = state.fits[names(best)]
        if found is None:
            break
        best = _unfolded(state, found, effects)
    state.limit.passed(_MOST_PARTS / (_MOST_PARTS + 1))
    if state.limit.cut:
        tried = {name for _, name in state.gains}
        state.late = tuple(
            effect.name for effect in effects if effect.name not in tried and not isinstance(effect, Dependence)
        )
        state.untestable |= dict.fromkeys(state.late, "the deadline came before it was tried")
    return state, _or_one_unknown(state, _pruned(state, best), effects)


def found_in_efforts(state: HypothesisSearch, refused: Collection[str] = ()) -> HypothesisFit:
    """The best model of joint efforts; without refused effects, those in whose place they were chosen have their turn.

    Args:
        state: of the search, to which the hypotheses are offered. refused: names of effects without proof.
    """
    effects = [each for each in state.library if each.name not in refused and not isinstance(each, FreeCurve)]
    return _together(state, screened(state.problem, effects))


def alone_in_efforts(state: HypothesisSearch, chosen: Collection[str]) -> HypothesisFit:
    """The best model of joint efforts with one of some effects; that of the nominal model where none explains anything.

    Alone, an event of free course explains most that others cause: it is left out.

    Args:
        state: of the search, to which the hypotheses are offered. chosen: names of the effects.
    """
    effects = [each for each in state.library if each.name in chosen and not each.free_course]
    tried = beside(state.judging.weighed(), (), effects, state.limit)[:_PROMISING]
    found = [_together(state, [FittedEffect(each.effect, each.values)]) for each in tried if each.gain > 0.0]
    possible = [each for each in found if np.isfinite(state.fits[names(each)].log_evidence)]
    return max(possible, key=lambda each: state.fits[names(each)].log_evidence, default=state.fits[()])


def testable(problem: Problem, library: Sequence[Effect] | None) -> tuple[list[Effect], dict[str, str]]:
    """The effects of a library (None: all) on the signal, and those that the recording cannot show, with the cause."""
    effects, untestable = [], {}
    for known in all_effects() if library is None else library:
        effect = on_efforts(known, problem.recorded) if problem.signal == "effort" else known
        if effect.signal != problem.signal or effect.direct:
            continue
        reason = effect.untestable(problem.recorded) or _identified(problem, effect)
        if reason:
            untestable[effect.name] = reason
        else:
            effects.append(effect)
    return effects, untestable


def _or_one_unknown(state: HypothesisSearch, best: HypothesisFit, effects: Sequence[Effect]) -> HypothesisFit:
    """The best model, or one free curve over a state in the place of several names, where it is as likely.

    Rounds add one effect at a time: a name that imitates an unknown effect in part is followed by others that imitate
    what it leaves. One cause that the library lacks is then the simpler explanation.
    """
    if sum(not isinstance(part.effect, Dependence) for part in best.parts) < 2 or state.limit.over():
        return best
    least = _BESIDE_CURVES * (best.log_evidence - state.fits[()].log_evidence)
    gains = {each.name: state.gains.get(((), each.name), 0.0) for each in effects}
    curves = [each for each in effects if isinstance(each, Dependence) and gains[each.name] > least]
    if not curves:
        return best
    curve = max(curves, key=lambda each: gains[each.name])
    problem = state.under(best)
    alone = state.fitted(problem, [FittedEffect(curve, {}).carried(problem.recorded)], WARM_STEPS)
    return alone if alone.log_evidence >= state.fits[names(best)].log_evidence else best


def _together(state: HypothesisSearch, parts: Sequence[FittedEffect]) -> HypothesisFit:
    """Several effects of joint efforts under the noise that they leave, and the same without each of them."""
    if not parts:
        return state.fits[()]
    predicted = state.problem.predicted(state.problem.compose(parts)[1])
    rough = state.problem.with_noise(state.problem.fitted_noise(state.problem.unexplained(predicted)))
    settled = _possible(state, rough.weighed(), fit(rough.weighed(), parts, _STEPS))
    problem = state.under(settled)
    best = state.fitted(problem, settled.parts, 0)
    for part in best.parts:
        state.fitted(problem, [other for other in best.parts if other is not part], WARM_STEPS)
    return best


def _possible(state: HypothesisSearch, problem: Problem, found: HypothesisFit) -> HypothesisFit:
    """The fit, with the simple effects in the place of a combination whose values are impossible."""
    recorded, rest = problem.recorded, list(found.parts)
    for part in found.parts:
        if part.effect.made_of and part.effect.implausible(recorded, part.values):
            rest.remove(part)
            known = {other.effect.name for other in rest}
            pieces = [each for each in state.library if each.name in part.effect.made_of and each.name not in known]
            rest += [FittedEffect(each, _alone(each, part, recorded)) for each in pieces]
    return found if tuple(rest) == tuple(found.parts) else fit(problem, rest, _STEPS)


def _needed(found: HypothesisFit, best: HypothesisFit, nominal: float) -> float:
    """log evidence by which a model must exceed one with an effect less."""
    more = Counter(names(found)) - Counter(names(best))
    new = next((part.effect for part in found.parts if part.effect.name in more), None)
    if new is None:
        return _NEW_PHYSICS
    first = _UNKNOWN if isinstance(new, Dependence) else _WIDER if new.widens else _NEW_PHYSICS
    if not best.parts:
        return first
    won = best.log_evidence - nominal if any(alike(new, part.effect) for part in best.parts) else 0.0
    return max(first + _NEXT_MORE, _NEXT_THRESHOLD) + LOOKALIKE * max(won, 0.0)


def _unfolded(state: HypothesisSearch, best: HypothesisFit, effects: Sequence[Effect]) -> HypothesisFit:
    """The best model, or one with the simple effects in place of their combination, when nearly as good."""
    known = {part.effect.name for part in best.parts}
    for part in best.parts:
        pieces = [each for each in effects if each.name in part.effect.made_of and each.name not in known]
        if not pieces:
            continue
        rest = [other for other in best.parts if other is not part]
        made = [FittedEffect(each, _alone(each, part, state.problem.recorded)) for each in pieces]
        tried = state.fitted(state.under(best), [*rest, *made], _STEPS)
        won = best.log_evidence - state.fits[()].log_evidence
        if tried.log_evidence >= best.log_evidence - LOOKALIKE * max(won, 0.0):
            return tried
    return best


def _alone(effect: Effect, whole: FittedEffect, recorded: RecordedMotion) -> Values:
    """Values to fit a piece of a combination from: the common non-linear ones, and zero."""
    parameters = effect.parameters(recorded)
    return {
        p.name: 0.0 if p.linear else min(max(whole.values.get(p.name, p.from_unit(0.5)), p.low), p.high)
        for p in parameters
    }


def _identified(problem: Problem, effect: Effect) -> str:
    known = effect.widens == "payload" and problem.model.payload_identified
    return "the payload was identified from this recording: give it in model.yaml" if known else ""


def _pruned(state: HypothesisSearch, best: HypothesisFit) -> HypothesisFit:
    """Without parts that later ones made redundant."""
    while len(best.parts) > 1 and not state.limit.over():
        problem = state.under(best)
        shorter = []
        for part in best.parts:
            rest = state.fitted(problem, [other for other in best.parts if other is not part], _STEPS)
            shorter.append(state.fits[names(rest)])
        top = max(shorter, key=lambda each: each.log_evidence)
        if best.log_evidence - top.log_evidence > _NEXT_THRESHOLD:
            break
        best = top
    return best


def _round(state: HypothesisSearch, best: HypothesisFit, effects: Sequence[Effect]) -> HypothesisFit | None:
    """The best model with one more supported effect, under its noise model."""
    chosen = prescreen(state, best, effects)
    if not chosen:
        return None
    problem = state.under(best)
    # At the deadline the most promising hypothesis is still fitted.
    within = (parts for number, parts in enumerate(chosen) if not (state.limit.over() and number))
    found = [state.fitted(problem, parts, _STEPS) for parts in within]
    found = sorted((each for each in found if np.isfinite(each.log_evidence)), key=lambda each: -each.log_evidence)
    if not found:
        return None
    # Under the noise of the best fit, fits near it and the previous model; and these under the noise of the latter:
    # evidence is compared under equal noise.
    quieter, louder = state.under(found[0]), state.judged(best)
    won = found[0].log_evidence - state.fits[()].log_evidence
    top = [each for each in found if each.log_evidence > found[0].log_evidence - max(NEAR, NEAR_SHARE * won)]
    for each in (*top, best):
        state.fitted(quieter, each.parts, WARM_STEPS)
    for each in top if louder is not problem else ():
        state.fitted(louder, each.parts, WARM_STEPS)
    before, nominal = state.fits[names(best)], state.fits[()].log_evidence
    judged = [state.fits[names(each)] for each in found]
    good = [each for each in judged if each.log_evidence - before.log_evidence >= _needed(each, before, nominal)]
    good = [each for each in good if exceeds_tolerance(quieter, each.parts, each.parts[-1].effect)]
    return _simplest(good, nominal) if good else None


def _simplest(found: Sequence[HypothesisFit], nominal: float) -> HypothesisFit:
    """The best fit, or one with fewer parameters of an effect that it is confused with and that is nearly as good."""
    best = max(found, key=lambda each: each.log_evidence)
    near = best.log_evidence - LOOKALIKE * max(best.log_evidence - nominal, 0.0)
    own = best.parts[-1].effect
    similar = [each for each in found if each.log_evidence >= near and alike(own, each.parts[-1].effect)]
    return min((best, *similar), key=lambda each: each.regression.count)


def prescreen(
    state: HypothesisSearch, best: HypothesisFit, effects: Sequence[Effect]
) -> list[tuple[FittedEffect, ...]]:
    """Each effect added to the present best model: the few hypotheses that deserve a full fit."""
    taken = {name for part in best.parts for name in (part.effect.name, *part.effect.made_of)}
    known = Counter(names(best))
    free = [effect for effect in effects if effect.name not in taken or 0 < known[effect.name] < effect.most]
    problem = state.under(best).calm(best.parts)
    # What wins less than a part of what a further name needs is not refined: neither is it named, nor is it a rival.
    found = beside(problem, best.parts, free, state.limit, least=_FURTHER * LEAST_BESIDE if best.parts else THRESHOLD)
    for each in found:
        if not taken & set(each.effect.made_of):
            state.gains[names(best), each.effect.name] = each.gain
        if not best.parts and each.visibility < _VISIBLE and not isinstance(each.effect, Dependence):
            state.untestable[each.effect.name] = (
                f"this motion does not show it; this would: {each.effect.separating_motion}"
            )
    if not found or found[0].gain < 0.0:
        return []
    least = max(0.0, found[0].gain - max(NEAR, NEAR_SHARE * found[0].gain))
    chosen = [each for each in _few_unknown(found) if each.gain > least][:_PROMISING]
    if any(each.effect.delay for each in chosen):
        # Beside one delay another one is compared in full: the smoothing in the calibration moves with each of them.
        chosen += [each for each in found if each.effect.delay and each.gain > least and each not in chosen]
    likelier = {name for each in chosen for name in each.effect.commoner}
    chosen += [each for each in found if each.effect.name in likelier and each.gain > least and each not in chosen]
    if all(isinstance(each.effect, Dependence) for each in chosen):
        # A free curve follows an effect of the library in part; the effect is compared in full.
        named = [each for each in found if each.gain > _BESIDE_CURVES * found[0].gain and each not in chosen]
        chosen += [each for each in named if not isinstance(each.effect, Dependence)][:1]
    if not state.fast and any(each.effect.fast for each in chosen):
        state.quicken()
    recorded = state.problem.recorded  # screened at the middles of averages, which end earlier
    return [_with(best.parts, FittedEffect(each.effect, each.values).carried(recorded)) for each in chosen]


def _with(parts: Sequence[FittedEffect], new: FittedEffect) -> tuple[FittedEffect, ...]:
    """The parts and a new one, without those that it contains."""
    return (*(part for part in parts if part.effect.name not in new.effect.made_of), new)


def _few_unknown(candidates: list[EffectCandidate]) -> list[EffectCandidate]:
    """Without the pseudo-effects after the first two: states are similar."""
    unknown = [each for each in candidates if isinstance(each.effect, Dependence)]
    return [each for each in candidates if each not in unknown[2:]]
