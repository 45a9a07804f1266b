"""The diagnosis of a recording: where it differs from the simulation, which physics is missing, the held-out proof."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.mismatch.answer.belief import probability_of_none
from poise.mismatch.answer.calibration_estimate import CalibrationEstimate, calibration_estimates
from poise.mismatch.answer.named import NamedEffect, named_effects, shown_effects
from poise.mismatch.answer.residual_test import ResidualTest, judge_residual
from poise.mismatch.answer.residual_windows import ResidualWindow, locate
from poise.mismatch.answer.unknown_physics import UnknownPhysics, likelihoods, unclear, undetermined, unknown_physics
from poise.mismatch.effects import Effect, all_effects
from poise.mismatch.inference import (
    WARM_STEPS,
    EffectCandidate,
    HeldOutProof,
    HypothesisFit,
    HypothesisSearch,
    Problem,
    ProvenModel,
    TimeLimit,
    beside_stuck_joints,
    effort_problem,
    fit,
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
    wrench_problem,
)
from poise.mismatch.reading import NominalModel, with_model_effects, with_rest, without
from poise.mismatch.recorded import WRENCH_CHANNELS, RecordedMotion
from poise.notebooks import html_table
from poise.threads import in_one_thread
from poise.types import Array, Mask

_FOR_SEARCH, _FOR_RIVALS = 0.6, 0.85
"""Shares of the time until the deadline at which the search ends, and the comparison of the answer with its rivals; the
proof takes the rest."""
_REPLACED = 2
"""Times that an effect of the answer may be replaced by a better one."""
_ALLOWED, _LEAST = 0.15, 1e-3
"""Energy above that of noise that held-out samples may have, since calibration errors are extrapolated to them, and the
least one of the nominal model by which a misfit is divided."""

Verdict = Literal["none", "named", "unknown", "mixed"]
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


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What `diagnose` found, over all signals; `main` is the signal with the largest error.

    Args:
        examinations: of the signals that there are.
        seconds: that it took.
        missing: effects on signals that were not recorded, and why they were not tried.
    """

    examinations: tuple[SignalDiagnosis, ...]
    seconds: float
    missing: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        named = [f"{each.effect.name} ({each.belief.probability:.1%})" for each in self.findings]
        return f"Diagnosis({self.verdict}{': ' if named else ''}{', '.join(named)}, {self.seconds:.1f} s)"

    def _repr_html_(self) -> str:
        """The named effects with their probabilities, and the proof, for notebooks."""
        rows = [(each.effect.name, f"{each.belief.probability:.1%}", each.sentence) for each in self.findings]
        proof = self.main.proof
        errors = f"{proof.as_given:.2f} as given, {proof.augmented:.2f} with the effects"
        note = f"Held-out error, in units of the noise: {errors}."
        return html_table(f"Verdict: {self.verdict}", ("effect", "probability", ""), rows, [note])

    @property
    def main(self) -> SignalDiagnosis:
        """The signal with the largest error of the nominal model."""
        return max(self.examinations, key=lambda each: each.proof.nominal)

    @property
    def findings(self) -> tuple[NamedEffect, ...]:
        """The named effects, the likeliest first."""
        found = [finding for each in self.examinations for finding in each.findings]
        return tuple(sorted(found, key=lambda each: -each.belief.probability))

    @property
    def unknown(self) -> UnknownPhysics | None:
        """The part that no named effect explains, in the signal that shows it most."""
        found = [each for each in self.examinations if each.unknown is not None]
        return max(found, key=lambda each: each.residual_test.excess).unknown if found else None

    @property
    def verdict(self) -> Verdict:
        """none, named, unknown, or mixed: both named and unknown."""
        return verdict_of(self.findings, self.unknown)

    @property
    def complete(self) -> bool:
        """Whether the search ended before its deadline."""
        return not any(each.search.limit.cut for each in self.examinations)

    @property
    def probability(self) -> float:
        """Of the verdict `none`."""
        return float(np.prod([probability_of_none(each.search, each.unproven) for each in self.examinations]))

    @property
    def unproven(self) -> dict[str, str]:
        """Effects that the evidence supported, but that have no proof, and what it lacks."""
        return {name: why for each in self.examinations for name, why in each.unproven.items()}

    @property
    def untestable(self) -> dict[str, str]:
        """Effects that this recording cannot show, and why."""
        examined = {*self.unproven, *(finding.effect.name for finding in self.findings)}
        tried = {effect.name for each in self.examinations for effect in each.search.library}
        reasons = {name: why for name, why in self.missing.items() if name not in tried}
        reasons |= {name: why for each in self.examinations for name, why in each.search.untestable.items()}
        return {name: why for name, why in reasons.items() if name not in examined}

    @property
    def at_rest(self) -> dict[str, float]:
        """Shares of the efforts of joints that no fit uses: these joints stand still in their dry friction."""
        shares: dict[str, float] = {}
        for track in (each.problem.recorded.effort for each in self.examinations if each.problem.signal == "effort"):
            if track is not None and track.stuck is not None:
                shares |= zip(track.names, track.stuck.mean(axis=0).tolist(), strict=True)
        return {name: share for name, share in shares.items() if share}

    @property
    def rest_sentence(self) -> str:
        """Which efforts no fit uses, and why; "" where all are used."""
        shares = ", ".join(f"{100 * share:.0f} % of {name}" for name, share in self.at_rest.items())
        return f"Efforts that are not used, since dry friction holds the joint at rest: {shares}." if shares else ""

    @property
    def augmented(self) -> NominalModel:
        """The nominal model with the effects that were found."""
        model = self.main.problem.model
        return replace(model, effects=(*model.effects, *(each.component for each in self.findings)))


def verdict_of(named: Sequence[object], unknown: UnknownPhysics | None) -> Verdict:
    """The verdict when this was named, and this was not."""
    if unknown is None:
        return "named" if named else "none"
    return "mixed" if named else "unknown"


@in_one_thread
def diagnose(
    recorded: RecordedMotion,
    model: NominalModel,
    last: Mask | None = None,
    library: Sequence[Effect] | None = None,
    *,
    rivals: bool = True,
    deadline: float = math.inf,
    progress: Callable[[float], None] | None = None,
) -> Diagnosis:
    """Compare a recording with the nominal model.

    Args:
        recorded: the recording or recordings, see `poise.mismatch.reading`.
        model: tolerances and noise; the effects in it are part of the nominal model.
        last: (N,) the wrench samples of the last of several recordings, which no fit sees; None: a single recording,
            whose last 30 % are held out from the fits that prove the answer.
        library: effects to try; None: all.
        rivals: whether the proven answer is compared with other effects in the place of its own; without that,
            probabilities count the evidence alone.
        deadline: s after which the search ends with its best answer so far; the fits that prove it are always made.
        progress: is called with the completed share, 0 to 1.

    Raises:
        NoAnswerError: NOT_IDENTIFIABLE without a wrench and without usable efforts.
    """
    begin = time.perf_counter()
    if not (recorded.has("wrench") or recorded.has("effort")):
        raise NoAnswerError(ErrorCode.NOT_IDENTIFIABLE, "there is no wrench and no usable joint effort to examine")
    # Readings at a limit of the model are left out; clipped predictions would hide what acts before the limit.
    recorded = with_model_effects(recorded, [each for each in model.effects if each.name != "saturation"])
    signals = ["wrench"] if recorded.has("wrench") else []
    if recorded.effort is not None and recorded.effort.names:
        signals.append("effort")
    examined: list[SignalDiagnosis] = []
    for number, signal in enumerate(signals):
        left = deadline - (time.perf_counter() - begin)
        share = 1.0 / len(signals)
        limit = TimeLimit(_FOR_SEARCH * left / (len(signals) - number), progress, (number * share, share))
        problem = wrench_problem(recorded, model) if signal == "wrench" else _efforts(recorded, model, examined)
        problem = beside_stuck_joints(problem, library)
        suspects = frozenset(name for one in examined if one.unknown is not None for name in one.unproven)
        examined.append(_examined(problem, last, library, limit, suspects, rivals))
    missing = {
        effect.name: f"the recording has no {'wrench' if effect.signal == 'wrench' else 'joint efforts'}"
        for effect in (all_effects() if library is None else library)
        if effect.signal not in signals
    }
    return Diagnosis(tuple(examined), time.perf_counter() - begin, missing)


def _efforts(recorded: RecordedMotion, model: NominalModel, examined: Sequence[SignalDiagnosis]) -> Problem:
    """The joint efforts beside what the wrench showed of load, base and encoders.

    An effect must not be named for what the wrench's names leave: their parameters are fitted again, those of names
    that could replace them too, and what no name explains of the wrench acts on the joints as well.
    """
    widened: set[str] = set()
    for one in examined:
        known = [each for each in one.findings if each.effect.layer != "sensor"]
        recorded = with_model_effects(recorded, [each.component for each in known], events=True)
        likely = {each.effect.name for each in known} | {rival for each in one.findings for rival in each.belief.alike}
        widened |= {effect.widens for effect in all_effects() if effect.name in likely}
        if one.unknown is not None:
            names_given = {each.effect.name for each in one.findings}
            named = [part for part in one.best.parts if part.effect.name in names_given]
            explained = one.problem.predicted(one.problem.compose(named)[1]) + one.best.calibrated
            recorded = with_rest(recorded, one.problem.unexplained(explained))
    return effort_problem(recorded, model, frozenset(widened))


def _misfit(proof: HeldOutProof, excess: float) -> float:
    """Share of the nominal model's error that an answer leaves; all of it where no sample was held out to show it."""
    left = np.max([proof.augmented**2 - 1.0 - _ALLOWED, excess, 0.0])  # NaN stays
    misfit = float(left) / max(proof.in_range**2 - 1.0, _LEAST)
    return min(misfit, 1.0) if np.isfinite(misfit) else 1.0


def _at_stamps(recorded: RecordedMotion, last: Mask, seconds: Array) -> Mask:
    """A mask of wrench samples at the stamps of another signal."""
    return last if seconds is recorded.seconds else np.asarray(seconds >= recorded.seconds[int(np.argmax(last))])


def _examined(
    problem: Problem,
    last: Mask | None,
    library: Sequence[Effect] | None,
    limit: TimeLimit,
    suspects: frozenset[str],
    rivals: bool,
) -> SignalDiagnosis:
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
    rest = judge_residual(final, residual_of(final, best), best.regression.residual, _rounding(final, detected))
    left = unknown_physics(final, best, rest)
    beside = "" if left is None else next(iter(left.depends_on), "time")
    varied = variations(final, best.parts)
    named = named_effects(final, best, model, instead, varied, _misfit(proof, rest.excess), beside, suspects)
    unnamed = unclear(named)
    doubts = {each.effect.name: f"other causes are likelier: {likelihoods(each)}" for each in unnamed}
    effort = None if problem.signal == "wrench" else problem.recorded.effort
    channels = WRENCH_CHANNELS if effort is None else effort.names
    # With the best model's calibration: a calibration without the findings would be biased by them.
    off = final.measured - final.predicted(final.recorded) - best.calibrated
    return SignalDiagnosis(
        problem=final,
        nominal=nominal,
        best=best,
        search=state,
        findings=(*(each for each in named if each not in unnamed), *detected),
        unknown=unknown_physics(final, best, rest, undetermined(final, unnamed)),
        residual_test=rest,
        windows=locate(final.recorded, off, final.noise, channels),
        calibration=calibration_estimates(final, best),
        held_out=held,
        proof=proof,
        unproven=model.dropped | doubts,
    )


def _with_rivals(
    state: HypothesisSearch, best: HypothesisFit, seen: Problem, held: Mask, rivals: bool
) -> tuple[_Proven, tuple[dict[str, EffectCandidate], ...]]:
    """The proven model after better effects took the place of its own, and what each effect wins in each place."""
    found = _proven(state, best, seen, held)
    if not rivals:
        return found, tuple({} for _ in found[0].fit.parts)
    state.limit = state.limit.extended(_FOR_RIVALS / _FOR_SEARCH)
    instead = replacements(state, found[0].fit)
    for _ in range(_REPLACED):
        better = None if state.limit.over() else improved(state, found[0].fit, instead)
        if better is None:
            break
        tried = _proven(state, better, seen, held)
        if set(names(better)) - set(names(found[0].fit)) <= set(names(tried[0].fit)):
            found = tried
            instead = replacements(state, found[0].fit)
    return found, instead


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
        best = _settled(final, best)
        proof = held_out(replace(final, judged=None), best, held)
        dropped |= model.dropped
        if not best.parts or not proof.worse:
            return replace(model, dropped=dropped), final, best, proof
        best = model.shorter()
        lost = set(names(model.fit)) - set(names(best))
        dropped |= dict.fromkeys(lost, "the error on held-out samples is larger with it")


def _settled(final: Problem, best: HypothesisFit) -> HypothesisFit:
    """The fit under the final noise."""
    if final.signal == "wrench":
        return fit(final, best.parts, WARM_STEPS)
    return fit(final, fit(final.weighed(), best.parts, WARM_STEPS).parts, 0)


def _rounding(problem: Problem, detected: Sequence[NamedEffect]) -> Array | float:
    """(C,) one sigma of the rounding of the readings; 0 without rounding."""
    rounded = [each for each in detected if each.effect.name == "quantisation"]
    scatter = [np.ptp(each.effect.simulate(problem.recorded, each.values), axis=0) / np.sqrt(12.0) for each in rounded]
    return np.asarray(np.sum(scatter, axis=0)) if scatter else 0.0
