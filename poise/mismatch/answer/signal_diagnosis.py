"""One signal of a recording, examined: what the search found, what is proven of it, and what is left."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from poise.mismatch.answer.calibration_estimate import CalibrationEstimate, calibration_estimates
from poise.mismatch.answer.named import NamedEffect, named_effects, shown_effects, within_errors
from poise.mismatch.answer.residual_test import ResidualTest, bursts_of, excess_of, judge_residual
from poise.mismatch.answer.residual_windows import ResidualWindow, locate
from poise.mismatch.answer.unknown_physics import (
    UnknownPhysics,
    doubts,
    pieces_of_a_course,
    unclear,
    undetermined,
    unknown_physics,
)
from poise.mismatch.effects import Effect
from poise.mismatch.inference import (
    WARM_STEPS,
    Dependence,
    EffectCandidate,
    FittedEffect,
    HeldOutProof,
    HypothesisFit,
    HypothesisSearch,
    Problem,
    ProvenModel,
    TimeLimit,
    allowed_excess,
    alone_in_efforts,
    fit,
    found_in_efforts,
    held_out,
    improved,
    names,
    proven,
    relative_error,
    replacements,
    residual_of,
    search,
    tail,
    variations,
)
from poise.mismatch.reading import without
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array, Mask

FOR_SEARCH, _FOR_RIVALS = 0.6, 0.85
"""Shares of the time until the deadline at which the search ends, and the comparison of the answer with its rivals; the
proof takes the rest."""
_REPLACED = 2
"""Times that an effect of the answer may be replaced by a better one."""
_TURNS = 3
"""Times that effects on efforts are chosen again without those that lack a proof."""
_NO_BETTER = 1.02
"""Held-out error beside another answer as good, relative to the error of that one, from which this is no better."""
_LEAST = 1e-3
"""Least energy above that of noise of the nominal model by which a misfit is divided."""

_Proven = tuple[ProvenModel, Problem, HypothesisFit, HeldOutProof]


@dataclass(frozen=True, eq=False)
class SignalDiagnosis:
    """One signal of a recording, examined.

    Args:
        problem: the signal, under the noise that the best model leaves.
        nominal, best: the fits without and with the findings.
        search: all hypotheses that were tried.
        findings: the named effects, the likeliest first.
        unknown: or None.
        residual_test: of what the best model leaves.
        windows: in which the nominal model is off.
        calibration: its errors as fitted, inside their tolerances.
        held_out: (N,) the samples that no fit of the proof sees.
        proof: errors on them.
        unproven: effects that the evidence supported, but that have no proof, and what it lacks.
    """

    problem: Problem
    nominal: HypothesisFit
    best: HypothesisFit
    search: HypothesisSearch
    findings: tuple[NamedEffect, ...]
    unknown: UnknownPhysics | None
    residual_test: ResidualTest
    windows: tuple[ResidualWindow, ...]
    calibration: tuple[CalibrationEstimate, ...]
    held_out: Mask
    proof: HeldOutProof
    unproven: dict[str, str]

    @property
    def nrmse(self) -> Array:
        """(2, C) error of the nominal model as given and of the best fit, relative to the measured signal."""
        problem, rows = self.problem, self.problem.active
        predicted = problem.predicted(problem.recorded)
        left = problem.left_by(predicted + self.best.response + self.best.calibrated)
        signal, *errors = (
            np.sqrt(np.mean(part[rows] ** 2, axis=0)) for part in (problem.measured, problem.measured - predicted, left)
        )
        return relative_error(np.array(errors), signal)


def _at_stamps(recorded: RecordedMotion, last: Mask, seconds: Array) -> Mask:
    """A mask of wrench samples at the stamps of another signal."""
    return last if seconds is recorded.seconds else np.asarray(seconds >= recorded.seconds[int(np.argmax(last))])


def examined_signal(
    problem: Problem,
    last: Mask | None,
    library: Sequence[Effect],
    limit: TimeLimit,
    suspects: frozenset[str],
    rivals: bool,
) -> SignalDiagnosis:
    """One signal against the model.

    Args:
        problem: the signal. last, library, rivals: see `diagnose`.
        limit: time of the search.
        suspects: effects that another signal supports without proof, see `beliefs`.
    """
    seen, looked, held = problem, problem, tail(problem)
    if last is not None:
        # The last of several recordings is not used before the proof.
        held = _at_stamps(problem.recorded, last, problem.seconds)
        seen = replace(problem, judged=~held)
        looked = problem.of(without(problem.recorded, last))
    state, best = search(looked, library, limit)
    (model, final, best, proof), instead = _with_rivals(state, best, seen, held, rivals)
    nominal = fit(final, ()) if best.parts else best
    detected = shown_effects(final, best, library)
    rest = judge_residual(
        final, residual_of(final, best), best.regression.residual, _rounding(final, detected), best.parts
    )
    left = unknown_physics(final, best, rest)
    beside = "" if left is None else next(iter(left.depends_on), "time")
    varied = variations(final, best.parts)
    named = named_effects(final, best, model, instead, varied, _misfit(proof, rest.excess), beside, suspects)
    unnamed = unclear(named)
    pieces = pieces_of_a_course(named, unnamed)
    # With the best model's calibration: a calibration without the findings would be biased by them.
    off = final.measured - final.predicted(final.recorded) - best.calibrated
    return SignalDiagnosis(
        problem=final,
        nominal=nominal,
        best=best,
        search=state,
        findings=(*(each for each in named if each not in (*unnamed, *pieces)), *detected),
        unknown=unknown_physics(final, best, rest, undetermined(final, unnamed)),
        residual_test=rest,
        windows=locate(final.recorded, off, final.noise, final.channels),
        calibration=calibration_estimates(final, best),
        held_out=held,
        proof=proof,
        unproven=model.dropped | doubts(unnamed, pieces),
    )


def _with_rivals(
    state: HypothesisSearch, best: HypothesisFit, seen: Problem, held: Mask, rivals: bool
) -> tuple[_Proven, tuple[dict[str, EffectCandidate], ...]]:
    """The proven model after better effects took the place of its own, and what each effect wins in each place."""
    found = _proven(state, best, seen, held)
    if seen.signal == "effort":
        found = _without_refused(state, found, seen, held)
    if not rivals:
        return found, tuple({} for _ in found[0].fit.parts)
    state.limit = state.limit.extended(_FOR_RIVALS / FOR_SEARCH)
    instead = replacements(state, found[0].fit)
    for _ in range(_REPLACED):
        better = None if state.limit.over() else improved(state, found[0].fit, instead)
        if better is None:
            break
        tried = _proven(state, better, seen, held)
        kept = set(names(better)) - set(names(found[0].fit)) <= set(names(tried[0].fit))
        if kept and not _predicts_worse(tried, found, held):
            found = tried
            instead = replacements(state, found[0].fit)
    return found, instead


def _predicts_worse(tried: _Proven, found: _Proven, held: Mask) -> bool:
    """Whether held-out samples are predicted worse than with the model found so far, in the units of its noise."""
    final = found[1]
    beside = _settled(final, tried[2].parts)
    return held_out(replace(final, judged=None), beside, held).augmented > _NO_BETTER * found[3].augmented


def _without_refused(state: HypothesisSearch, found: _Proven, seen: Problem, held: Mask) -> _Proven:
    """A model of joint efforts without the effects that lack a proof, where others in their place explain more.

    Effects on efforts are chosen together: one without a proof, such as an event that pulls, keeps others away or takes
    a piece of what they explain. So events alone are left out first. Within the noise nothing is left to explain.
    """
    events = frozenset(each.name for each in state.library if each.free_course)
    refused: set[str] = set()
    for _ in range(_TURNS):
        if state.limit.over() or refused.issuperset(found[0].dropped) or _within_noise(found):
            break
        refused |= (events & found[0].dropped.keys()) - refused or found[0].dropped.keys()
        best = found_in_efforts(state, refused)
        if set(names(best)) <= set(names(found[0].fit)) and not _explains_more(best, found):
            continue
        tried = _proven(state, best, seen, held)
        found = _after(found, tried if tried[3].augmented < found[3].augmented else found, tried)
    if found[0].fit.parts or not found[0].dropped or _within_noise(found) or state.limit.over():
        return found
    # Effects that were chosen together may all lack a proof beside each other.
    alone = _proven(state, alone_in_efforts(state, found[0].dropped), seen, held)
    return _after(found, alone, alone)


def _within_noise(found: _Proven) -> bool:
    """Whether nothing is left to explain, on held-out samples and on all: an effect may hardly act on the former."""
    _, final, best, proof = found
    left = residual_of(final, best)
    calm = proof.excess <= 0.0 and excess_of(final, left) <= allowed_excess(final)
    return calm and not bursts_of(final, left, best.parts)


def _explains_more(best: HypothesisFit, found: _Proven) -> bool:
    """Whether a fit of the same effects has better values: beside refused effects, a fit ends in another valley."""
    final = found[1]
    carried = [part.carried(final.recorded) for part in best.parts]
    return _settled(final, carried).log_evidence > found[2].log_evidence


def _after(found: _Proven, better: _Proven, tried: _Proven) -> _Proven:
    """The better of two proven models, with what lacks a proof in either."""
    return (replace(better[0], dropped=found[0].dropped | tried[0].dropped), *better[1:])


def _proven(state: HypothesisSearch, best: HypothesisFit, seen: Problem, held: Mask) -> _Proven:
    """The largest model whose effects have their proof and that does not increase the held-out error.

    Returns:
        The model with its proofs; the signal under the noise that it leaves, its fit there, and the held-out errors.
    """
    dropped: dict[str, str] = {}
    while True:
        model = proven(state, best)
        best = model.fit
        if state.problem is not seen:
            best = fit(seen, [part.carried(seen.recorded) for part in best.parts], WARM_STEPS)
        final = seen.with_noise(seen.fitted_noise(residual_of(seen, best)))
        best = _settled(final, best.parts)
        dropped |= model.dropped
        vain = _of_no_size(final, best)
        if vain is not None:
            dropped[best.parts[vain].effect.name] = "its sizes are nothing within their errors"
            best = model.without[vain]
            continue
        proof = held_out(replace(final, judged=None), best, held)
        if not best.parts or not proof.worse:
            return replace(model, dropped=dropped), final, best, proof
        best = model.shorter()
        lost = set(names(model.fit)) - set(names(best))
        dropped |= dict.fromkeys(lost, "the error on held-out samples is larger with it")


def _of_no_size(final: Problem, best: HypothesisFit) -> int | None:
    """An effect on joint efforts whose sizes, estimated by least squares in time, are nothing within their errors.

    The proof weighs the residual by its spectrum: it may rest on the moments of a reversal or of a step of a converter.
    """
    if final.signal == "wrench":
        return None
    acting = zip(best.parts, final.compose(best.parts)[0], best.covariance_with_misfit(), strict=True)
    vain = (within_errors(*each) and not isinstance(each[0].effect, Dependence) for each in acting)
    return next((index for index, found in enumerate(vain) if found), None)


def _settled(final: Problem, parts: Sequence[FittedEffect]) -> HypothesisFit:
    """The fit of effects under the final noise."""
    if final.signal == "wrench":
        return fit(final, parts, WARM_STEPS)
    return fit(final, fit(final.weighed(), parts, WARM_STEPS).parts, 0)


def _rounding(problem: Problem, detected: Sequence[NamedEffect]) -> Array | float:
    """(C,) one sigma of the rounding of the readings; 0 without rounding."""
    rounded = [each for each in detected if each.effect.name == "quantisation"]
    scatter = [np.ptp(each.effect.simulate(problem.recorded, each.values), axis=0) / np.sqrt(12.0) for each in rounded]
    return np.asarray(np.sum(scatter, axis=0)) if scatter else 0.0


def _misfit(proof: HeldOutProof, excess: float) -> float:
    """Share of the nominal model's error that an answer leaves; all of it where no sample was held out to show it."""
    left = np.max([proof.excess, excess, 0.0])  # NaN stays
    misfit = float(left) / max(proof.in_range**2 - 1.0, _LEAST)
    return min(misfit, 1.0) if np.isfinite(misfit) else 1.0
