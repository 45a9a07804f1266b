"""The diagnosis of a recording: where it differs from the simulation, which physics is missing, the held-out proof."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from poise.errors import ErrorCode, NoAnswerError
from poise.mismatch.answer.effort_witness import contradicted
from poise.mismatch.answer.named import NamedEffect
from poise.mismatch.answer.signal_diagnosis import FOR_SEARCH, SignalDiagnosis, examined_signal
from poise.mismatch.answer.unknown_physics import UnknownPhysics
from poise.mismatch.effects import Effect, all_effects
from poise.mismatch.inference import Problem, TimeLimit, beside_stuck_joints, effort_problem, wrench_problem
from poise.mismatch.reading import NominalModel, with_joint_physics, with_model_effects, with_rest
from poise.mismatch.recorded import RecordedMotion
from poise.notebooks import html_table
from poise.threads import in_one_thread
from poise.types import Mask

_CONTRADICTIONS = 2
"""Times that the efforts may contradict the names of the wrench, which is then examined without these effects."""
Verdict = Literal["none", "named", "unknown", "mixed"]


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
    def unproven(self) -> dict[str, str]:
        """Effects that the evidence supported, but that have no proof, and what it lacks."""
        return {name: why for each in self.examinations for name, why in each.unproven.items()}

    @property
    def untestable(self) -> dict[str, str]:
        """Effects that no signal of this recording can show, and why."""
        examined = {*self.unproven, *(finding.effect.name for finding in self.findings)}
        tried = {effect.name for each in self.examinations for effect in each.search.library}
        reasons = {name: why for name, why in self.missing.items() if name not in tried}
        reasons |= {name: why for each in self.examinations for name, why in each.search.untestable.items()}
        late = {name for each in self.examinations for name in each.search.late}
        for each in self.examinations:
            able = {effect.name for effect in each.search.library} - each.search.untestable.keys()
            examined |= able - late
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
    if not (recorded.has("wrench") or recorded.has("effort")):
        raise NoAnswerError(ErrorCode.NOT_IDENTIFIABLE, "there is no wrench and no usable joint effort to examine")
    # Readings at a limit of the model are left out; clipped predictions would hide what acts before the limit.
    recorded = with_model_effects(recorded, [each for each in model.effects if each.name != "saturation"])
    recorded = with_joint_physics(recorded, model.effects)
    signals = ["wrench"] if recorded.has("wrench") else []
    if recorded.effort is not None and recorded.effort.names:
        signals.append("effort")
    tried = all_effects() if library is None else library
    examination = _Examination(recorded, model, last, tried, rivals, deadline, progress, signals)
    examined = examination.of_all()
    missing = {
        effect.name: "there is no wrench to examine"
        if effect.signal == "wrench"
        else "there are no usable joint efforts"
        for effect in tried
        if effect.signal not in signals
    }
    return Diagnosis(examined, time.perf_counter() - examination.begin, missing)


@dataclass
class _Examination:
    """The signals of a recording; see `diagnose`."""

    recorded: RecordedMotion
    model: NominalModel
    last: Mask | None
    library: Sequence[Effect]
    rivals: bool
    deadline: float
    progress: Callable[[float], None] | None
    signals: Sequence[str]
    begin: float = field(default_factory=time.perf_counter)

    def of_all(self) -> tuple[SignalDiagnosis, ...]:
        """One signal after the other, and again without the names of the wrench that the efforts contradict."""
        refuted: dict[str, str] = {}
        found = self._of_each(refuted)
        for _ in range(_CONTRADICTIONS if len(found) > 1 else 0):
            wrench, efforts = found
            seen = None if self.last is None else ~efforts.held_out
            against = contradicted(self.recorded, self.model, wrench.findings, efforts, seen)
            if not against or any(each.search.limit.cut for each in found):
                break
            refuted |= dict.fromkeys(against, "the joint efforts contradict it")
            found = self._of_each(refuted)
        return found

    def _of_each(self, refuted: dict[str, str]) -> tuple[SignalDiagnosis, ...]:
        """Every signal, the wrench without some effects."""
        found: list[SignalDiagnosis] = []
        for signal in self.signals:
            if signal == "wrench":
                without, problem = refuted, wrench_problem(self.recorded, self.model)
            else:
                without, problem = {}, beside_stuck_joints(_efforts(self.recorded, self.model, found), self.library)
            library = [each for each in self.library if each.name not in without]
            suspects = frozenset(name for one in found if one.unknown is not None for name in one.unproven)
            limit = self._limit(len(found), None if refuted else self.progress)
            one = examined_signal(problem, self.last, library, limit, suspects, self.rivals)
            found.append(replace(one, unproven=one.unproven | without))
        return tuple(found)

    def _limit(self, before: int, progress: Callable[[float], None] | None) -> TimeLimit:
        """The time that a search has after `before` signals."""
        left, share = self.deadline - (time.perf_counter() - self.begin), 1.0 / len(self.signals)
        return TimeLimit(FOR_SEARCH * left / (len(self.signals) - before), progress, (before * share, share))


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
