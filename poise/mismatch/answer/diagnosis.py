"""The diagnosis of a recording: where it differs from the simulation, which physics is missing, the held-out proof."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.mismatch.answer.belief import MAX_PROBABILITY, EffectBelief, beliefs, probability_of_none
from poise.mismatch.answer.calibration_estimate import CalibrationEstimate, calibration_estimates
from poise.mismatch.answer.residual_test import ResidualTest, judge_residual
from poise.mismatch.answer.residual_windows import ResidualWindow, locate
from poise.mismatch.effects import Effect, Values, all_effects
from poise.mismatch.inference import (
    WARM_STEPS,
    Dependence,
    DependenceCurve,
    FittedEffect,
    HeldOutProof,
    HypothesisFit,
    HypothesisSearch,
    Problem,
    dependence_curve,
    effort_problem,
    fit,
    held_out,
    names,
    residual_of,
    search,
    state_description,
    tail,
    wrench_problem,
)
from poise.mismatch.reading import ModelEffect, NominalModel, with_model_effects, without
from poise.mismatch.recorded import WRENCH_CHANNELS, RecordedMotion
from poise.types import Array, Mask

Verdict = Literal["none", "named", "unknown", "mixed"]


@dataclass(frozen=True, eq=False)
class Quantity:
    """A number with its one-sigma error, NaN when unknown."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """One effect of the answer."""

    effect: Effect
    values: Values
    covariance: Array
    belief: EffectBelief
    parameters: dict[str, Quantity]
    windows: tuple[tuple[float, float], ...]
    sentence: str

    @property
    def component(self) -> ModelEffect:
        """As it joins a model."""
        return ModelEffect(self.effect.name, dict(self.values), self.covariance)


@dataclass(frozen=True, eq=False)
class UnknownPhysics:
    """Physics outside the library: the states that it correlates with, and its curve if there is one."""

    depends_on: tuple[str, ...]
    sentence: str
    shape: DependenceCurve | None


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
        if self.unknown is None:
            return "named" if self.findings else "none"
        return "mixed" if self.findings else "unknown"

    @property
    def probability(self) -> float:
        """Of the verdict `none`."""
        return float(np.prod([probability_of_none(each.search) for each in self.examinations]))

    @property
    def untestable(self) -> dict[str, str]:
        """Effects that this recording cannot show, and why."""
        named = {finding.effect.name for finding in self.findings}
        tried = {name for each in self.examinations for _, name in each.search.gains}
        reasons = {name: why for name, why in self.missing.items() if name not in tried}
        reasons |= {name: why for each in self.examinations for name, why in each.search.untestable.items()}
        return {name: why for name, why in reasons.items() if name not in named}

    @property
    def augmented(self) -> NominalModel:
        """The nominal model with the effects that were found."""
        model = self.main.problem.model
        return replace(model, effects=(*model.effects, *(each.component for each in self.findings)))


def diagnose(
    recorded: RecordedMotion,
    model: NominalModel,
    last: Mask | None = None,
    library: Sequence[Effect] | None = None,
) -> Diagnosis:
    """Compare a recording with the nominal model.

    Args:
        recorded: the recording or recordings, see `poise.mismatch.reading`.
        model: tolerances and noise; the effects in it are part of the nominal model.
        last: (N,) the wrench samples of the last of several recordings, which no fit sees; None: a single recording,
            whose last 30 % are held out from the fits that prove the answer.
        library: effects to try; None: all.

    Raises:
        NoAnswerError: NOT_IDENTIFIABLE without a wrench and without usable efforts.
    """
    begin = time.perf_counter()
    if not (recorded.has("wrench") or recorded.has("effort")):
        raise NoAnswerError(ErrorCode.NOT_IDENTIFIABLE, "there is no wrench and no usable joint effort to examine")
    recorded = with_model_effects(recorded, model.effects)
    problems = [wrench_problem(recorded, model)] if recorded.has("wrench") else []
    if recorded.effort is not None and recorded.effort.names:
        problems.append(effort_problem(recorded, model))
    examined = []
    for problem in problems:
        examined.append(_examined(problem, last, library))
    signals = {problem.signal for problem in problems}
    missing = {
        effect.name: f"the recording has no {'wrench' if effect.signal == 'wrench' else 'joint efforts'}"
        for effect in (all_effects() if library is None else library)
        if effect.signal not in signals
    }
    return Diagnosis(tuple(examined), time.perf_counter() - begin, missing)


def _at_stamps(recorded: RecordedMotion, last: Mask, seconds: Array) -> Mask:
    """A mask of wrench samples at the stamps of another signal."""
    return last if seconds is recorded.seconds else np.asarray(seconds >= recorded.seconds[int(np.argmax(last))])


def _examined(problem: Problem, last: Mask | None, library: Sequence[Effect] | None) -> SignalDiagnosis:
    seen, looked, held = problem, problem, tail(problem)
    if last is not None:
        # The last of several recordings is not used before the proof.
        held = _at_stamps(problem.recorded, last, problem.seconds)
        seen = replace(problem, judged=~held)
        make = wrench_problem if problem.signal == "wrench" else effort_problem
        looked = make(without(problem.recorded, last), problem.model)
    state, best = search(looked, library)
    if looked is not seen:
        best = fit(seen, [_carried(part, seen.recorded) for part in best.parts], WARM_STEPS)
    final = seen.with_noise(seen.fitted_noise(residual_of(seen, best)))
    best = fit(final, best.parts, WARM_STEPS)
    nominal = fit(final, ()) if best.parts else best
    detected = _shown(final, library)
    rest = judge_residual(final, residual_of(final, best), _whitened(best), _rounding(final, detected))
    unknown = _unknown(final, best, rest)
    doubted = unknown is not None and (unknown.shape is not None or not rest.only_louder)
    channels = (
        WRENCH_CHANNELS
        if problem.recorded.effort is None or problem.signal == "wrench"
        else problem.recorded.effort.names
    )
    return SignalDiagnosis(
        problem=final,
        nominal=nominal,
        best=best,
        search=state,
        findings=(*_findings(final, state, best, beside_unknown=doubted), *detected),
        unknown=unknown,
        residual_test=rest,
        # With the best model's calibration: a calibration without the findings would be biased by them.
        windows=locate(
            final.recorded, final.measured - final.predicted(final.recorded) - best.calibrated, final.noise, channels
        ),
        calibration=calibration_estimates(final, best),
        held_out=held,
        proof=held_out(replace(final, judged=None), best, held),
    )


def _carried(part: FittedEffect, recorded: RecordedMotion) -> FittedEffect:
    """A part in a longer recording, where a free curve over time has more knots."""
    return replace(part, values={p.name: part.values.get(p.name, 0.0) for p in part.effect.parameters(recorded)})


def _whitened(found: HypothesisFit) -> Array:
    """(R,) the whitened residual of a fit."""
    regression = found.regression
    return np.asarray(regression.target - regression.coefficients() @ regression.columns)


def _findings(
    problem: Problem, state: HypothesisSearch, best: HypothesisFit, *, beside_unknown: bool
) -> list[NamedEffect]:
    confidence = beliefs(state, names(best), beside_unknown=beside_unknown) if best.parts else {}
    inputs = problem.compose(best.parts)[0]
    found = [
        NamedEffect(
            part.effect,
            part.values,
            covariance,
            confidence[part.effect.name],
            quantities(part, recorded, covariance),
            part.effect.windows(recorded, part.values),
            part.effect.sentence(recorded, part.values),
        )
        for part, recorded, covariance in zip(best.parts, inputs, best.covariance, strict=True)
        if not isinstance(part.effect, Dependence)
    ]
    return sorted(found, key=lambda each: -each.belief.probability)


def _shown(problem: Problem, library: Sequence[Effect] | None) -> list[NamedEffect]:
    """Effects that the readings alone show, and that the model does not have already."""
    known = {component.name for component in problem.model.effects}
    found = []
    for effect in all_effects() if library is None else library:
        values = effect.detected(problem.recorded) if effect.signal == problem.signal and effect.direct else None
        if values is not None and effect.name not in known:
            parameters = effect.parameters(problem.recorded)
            covariance = np.diag([p.resolution**2 / 12.0 for p in parameters])
            reported = quantities(FittedEffect(effect, values), problem.recorded, covariance)
            sure, sentence = EffectBelief(MAX_PROBABILITY, (), (), None), effect.sentence(problem.recorded, values)
            found.append(NamedEffect(effect, values, covariance, sure, reported, (), sentence))
    return found


def _rounding(problem: Problem, detected: Sequence[NamedEffect]) -> Array | float:
    """(C,) one sigma of the rounding of the readings; 0 without rounding."""
    scatter = [np.ptp(each.effect.simulate(problem.recorded, each.values), axis=0) / np.sqrt(12.0) for each in detected]
    return np.asarray(np.sum(scatter, axis=0)) if scatter else 0.0


def quantities(part: FittedEffect, recorded: RecordedMotion, covariance: Array) -> dict[str, Quantity]:
    """The reported parameters with one-sigma errors, to first order for derived ones."""
    effect, values = part.effect, dict(part.values)
    parameters = effect.parameters(recorded)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    reported = {
        p.name: Quantity(float(values[p.name]), float(s), p.unit)
        for p, s in zip(parameters, sigma, strict=True)
        if not p.hidden
    }
    derived = effect.derived(recorded, values)
    if not derived:
        return reported
    slopes = np.zeros((len(derived), len(parameters)))
    for k, (p, s) in enumerate(zip(parameters, sigma.tolist(), strict=True)):
        if s > 0:
            moved = effect.derived(recorded, {**values, p.name: values[p.name] + 0.01 * s})
            slopes[:, k] = [(moved[name][0] - derived[name][0]) / (0.01 * s) for name in derived]
    spread = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0))
    for (name, (value, unit)), std in zip(derived.items(), spread.tolist(), strict=True):
        reported[name] = Quantity(value, std, unit)
    return reported


def _unknown(problem: Problem, best: HypothesisFit, rest: ResidualTest) -> UnknownPhysics | None:
    parts = [part for part in best.parts if isinstance(part.effect, Dependence)]
    if not parts and not rest.structured:
        return None
    depends = list(dict.fromkeys(part.effect.state for part in parts if isinstance(part.effect, Dependence)))
    depends += [state for state in rest.depends_on if state not in depends and not parts]
    first = parts[0] if parts else None
    if first is not None and isinstance(first.effect, Dependence):
        return UnknownPhysics(
            tuple(depends),
            first.effect.sentence(problem.recorded, first.values),
            dependence_curve(first.effect, problem.recorded, first.values),
        )
    if rest.louder:
        return UnknownPhysics(
            tuple(depends),
            "An effect outside the library remains: the sample-to-sample noise is larger while the robot moves fast "
            "than while it moves slowly, unlike the noise of a sensor.",
            None,
        )
    what = " and ".join(state_description(state) for state in depends) or "no recorded state"
    sentence = (
        f"An effect outside the library remains: the residual has {100 * rest.excess:.0f} % more energy than "
        f"the sensor's noise may have; it correlates with {what}."
    )
    return UnknownPhysics(tuple(depends), sentence, None)
