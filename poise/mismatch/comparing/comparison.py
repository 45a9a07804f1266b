"""What changed between two recordings of one robot."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.mismatch.answer import Diagnosis, NamedEffect, Quantity, Verdict, diagnose, verdict_of
from poise.mismatch.comparing.alignment import Alignment, align, postures
from poise.mismatch.comparing.difference import difference, unlike, with_motion_of
from poise.mismatch.reading import NominalModel, with_common_efforts, with_model_effects
from poise.mismatch.recorded import RecordedMotion
from poise.notebooks import html_table

_NEAR = 0.1
"""rad or m, the largest distance of postures that count as the same."""
_SHARED, _LEAST = 0.5, 5.0
"""Share of the motion, and s of it, that both recordings need for a comparison at the same postures."""
_ALIKE, _SLIP, _MARGIN = 0.05, 0.1, 0.3
"""Relative difference of the speeds within which what depends on the speed is the same in both; the one of single
samples, in units of the rms speed, and s around them: in a pause of one recording they differ."""
_SKEW = 0.002
"""Relative difference of two clocks, or of two speeds, from which it matters which of both it is."""
_CLEARLY = 1.02
"""Ratio of the evidence from which the answer about A against B is better than that about B against A."""
_REST = 0.1
"""Share of an effect that may be left where it is gone."""
_PER_RECORDING = ("bias_force", "bias_torque", "drift_force", "drift_torque", "clock_offset", "effort_offset")
"""Tolerances of what may differ at every start of a robot: two recordings may be at both edges."""
_OF_ROBOT, _LEFT = ("link_mass", "motor_gain", "sensor_gain", "sensor_rotation"), 0.2
"""Tolerances, with those of the payload, of what is the same in both recordings; this share of them may stay."""

_EQUAL_NOTE = "each recording by itself shows the same {}: it acts on what changed, and is no change"

Side = Literal["a", "b", "both"]


@dataclass(frozen=True, eq=False)
class Change:
    """An effect that changed from A to B.

    Args:
        finding: the effect, with its values as B minus A where `sign` is 1, as A minus B where it is -1.
        sign: see `finding`.
        present_in: the recording that has the effect, or both with other values.
        before: its parameters in A, where A has it, too.
    """

    finding: NamedEffect
    sign: int
    present_in: Side
    before: dict[str, Quantity]

    @property
    def change(self) -> dict[str, Quantity]:
        """Each parameter in B minus that in A."""
        return {n: replace(q, value=self.sign * q.value) for n, q in self.finding.parameters.items()}

    @property
    def more_in(self) -> Literal["a", "b"]:
        """The recording with more of it."""
        if self.present_in != "both":
            return self.present_in
        return "b" if self.sign > 0 else "a"

    @property
    def sentence(self) -> str:
        """For people."""
        name, lacking = self.finding.effect.name, {"a": "B", "b": "A"}
        if self.present_in == "both":
            return f"{name}: both recordings have it, and {self.more_in.upper()} has more."
        return f"{name}: recording {self.present_in.upper()} has it, and {lacking[self.present_in]} does not."


@dataclass(frozen=True, eq=False)
class Comparison:
    """The answer about two recordings.

    Args:
        diagnosis: of the difference, as the recording `side` has it.
        changes: the likeliest first.
        side: "b" when the answer describes B against A, "a" for A against B.
        alignment: of B with A.
        notes: how they were compared, one sentence each.
        seconds: that it took.
    """

    diagnosis: Diagnosis
    changes: tuple[Change, ...]
    side: Literal["a", "b"]
    alignment: Alignment
    notes: tuple[str, ...]
    seconds: float

    def _repr_html_(self) -> str:
        """What changed, and in which recording it is, for notebooks."""
        rows = [
            (each.finding.effect.name, each.present_in, f"{each.finding.belief.probability:.1%}", each.sentence)
            for each in self.changes
        ]
        headings = ("changed", "present in", "probability", "")
        return html_table(f"Verdict: {self.verdict}", headings, rows, self.notes)

    @property
    def verdict(self) -> Verdict:
        """none, named, unknown or mixed, as of a diagnosis."""
        return verdict_of(self.changes, self.diagnosis.unknown)


def compare(
    a: RecordedMotion,
    b: RecordedMotion,
    model: NominalModel,
    *,
    deadline: float = math.inf,
    progress: Callable[[float], None] = lambda share: None,
) -> Comparison:
    """What changed from recording A to recording B; what the model lacks in both cancels.

    At the same postures the readings of one are subtracted from those of the other, so that nothing has to be known
    of what both have. Where the speeds differ, what the other recording lacks is diagnosed first, and becomes part of
    the model.

    Args:
        a, b: of one robot, predicted with one model.
        model: of both.
        deadline: s after which the search ends with its best answer so far.
        progress: is called with the completed share, 0 to 1.

    Raises:
        InputError: BAD_INPUT when both are one recording; see `align` and `difference`.
        NoAnswerError: NOT_IDENTIFIABLE when the motions differ; see `diagnose`.
    """
    begin = time.perf_counter()
    _check_apart(a, b)
    uncompared = _uncompared(a, b)
    a, b = with_common_efforts([a, b])
    stages = _Stages(model, deadline, progress)
    matched = align(b, a)
    _check_same_path(matched)
    skew = matched.rate if _SKEW < abs(matched.rate - 1.0) < _ALIKE else 1.0
    if skew != 1.0:
        on_a = with_motion_of(b, a, matched.reversed())
        instead = align(on_a, a)
        if unlike(_less(on_a, a, instead)) < unlike(_less(b, a, matched)):
            b, matched = on_a, instead
    answers = {"b": _one_way(b, a, matched, stages)}
    if answers["b"].verdict != "none":
        answers["a"] = _one_way(a, b, matched.reversed(), stages)
    side: Literal["a", "b"] = "a" if "a" in answers and _better(answers["a"], answers["b"]) else "b"
    found = answers[side]
    changes = [_change(each, side, a, b, stages) for each in found.findings]
    equal = [each for each in changes if len(changes) > 1 and each.present_in == "both" and _equal(each, a, b, stages)]
    notes = [*uncompared, *_notes(matched, skew), *(_EQUAL_NOTE.format(each.finding.effect.name) for each in equal)]
    kept = tuple(each for each in changes if each not in equal)
    progress(1.0)
    return Comparison(found, kept, side, matched, tuple(notes), time.perf_counter() - begin)


def _check_apart(a: RecordedMotion, b: RecordedMotion) -> None:
    signals = [(a.wrench, b.wrench)] if a.has("wrench") else []
    if a.effort is not None and b.effort is not None:
        signals.append((a.effort.measured, b.effort.measured))
    if signals and all(one.shape == other.shape and np.array_equal(one, other) for one, other in signals):
        raise InputError(ErrorCode.BAD_INPUT, "compare: both recordings hold the same readings: give two recordings")


class _Stages:
    """The diagnoses of a comparison, their time limit and their progress."""

    def __init__(self, model: NominalModel, deadline: float, progress: Callable[[float], None]) -> None:
        self.model, self.for_two = model, _for_two(model)
        self._end, self._progress, self._done = time.perf_counter() + deadline, progress, 0.0
        self._alone = list[tuple[RecordedMotion, NominalModel, Diagnosis]]()

    def diagnose(self, recorded: RecordedMotion, model: NominalModel) -> Diagnosis:
        """A quarter of the progress."""
        done, left = self._done, max(self._end - time.perf_counter(), 0.1)
        self._done = min(done + 0.25, 0.75)
        return diagnose(recorded, model, deadline=left, progress=lambda share: self._progress(done + 0.25 * share))

    def alone(self, recorded: RecordedMotion, model: NominalModel) -> Diagnosis:
        """What a model lacks in one recording."""
        for each, known, found in self._alone:
            if each is recorded and known is model:
                return found
        self._alone.append((recorded, model, self.diagnose(recorded, model)))
        return self._alone[-1][2]


def _for_two(model: NominalModel) -> NominalModel:
    tolerance = model.tolerance
    changed = {name: 2.0 * getattr(tolerance, name) for name in _PER_RECORDING}
    same = (*_OF_ROBOT, "payload_mass", "payload_com", "payload_inertia")
    changed |= {name: _LEFT * getattr(tolerance, name) for name in same}
    return replace(model, tolerance=replace(tolerance, **changed))


def _same_path(matched: Alignment) -> bool:
    near = (matched.distance < _NEAR)[matched.moving]
    seconds = len(near) * float(np.median(np.diff(matched.seconds))) if len(near) else 0.0
    return seconds >= _LEAST and matched.share * near.mean() >= _SHARED


def _check_same_path(matched: Alignment) -> None:
    if not _same_path(matched):
        raise NoAnswerError(
            ErrorCode.NOT_IDENTIFIABLE,
            f"compare: only {matched.share:.0%} of B's motion is also in A, and {_SHARED:.0%} and {_LEAST:g} s are"
            " needed: record the same motion twice, or diagnose each recording with `poise mismatch`",
        )


def _same_speed(matched: Alignment) -> bool:
    return abs(matched.rate - 1.0) < _ALIKE


def _one_way(this: RecordedMotion, other: RecordedMotion, matched: Alignment, stages: _Stages) -> Diagnosis:
    """What this recording has and the other lacks."""
    common = stages.for_two if _same_speed(matched) else stages.alone(other, stages.for_two).augmented
    return stages.diagnose(_less(this, with_model_effects(other, common.effects), matched), common)


def _less(this: RecordedMotion, other: RecordedMotion, matched: Alignment) -> RecordedMotion:
    """This recording without what the other has too, where both move alike."""
    slip = math.inf
    if _same_speed(matched):
        _, seconds, places = postures(this)
        slip = _SLIP * float(np.sqrt(np.mean((np.gradient(places, seconds, axis=0) ** 2).sum(axis=1))))
    return difference(this, other, matched, matched.alike(_NEAR, slip, _MARGIN))


def _better(one: Diagnosis, usual: Diagnosis) -> bool:
    """Whether an answer has clearly more evidence: what has one sign is imitated badly the other way around."""
    return _evidence(one) > _CLEARLY * _evidence(usual)


def _evidence(found: Diagnosis) -> float:
    """Nats of the named effects, per sample: the faster recording has fewer."""
    nats = sum(each.belief.basis.evidence for each in found.findings if each.belief.basis is not None)
    return nats / sum(len(each.problem.seconds) for each in found.examinations)


def _change(
    finding: NamedEffect, side: Literal["a", "b"], a: RecordedMotion, b: RecordedMotion, stages: _Stages
) -> Change:
    """The change of an effect; the recording against which it was found may have it, too."""
    less, sign = (a, 1) if side == "b" else (b, -1)
    found = [each for each in stages.alone(less, stages.model).findings if each.effect.name == finding.effect.name]
    if not found:
        # A payload that is lighter than the model's is a load of the other recording.
        taken = "mass" in finding.parameters and finding.parameters["mass"].value < 0
        return Change(finding, sign, side if not taken else "a" if side == "b" else "b", {})
    own, delta = found[0].parameters, finding.parameters
    total = {
        n: Quantity(q.value + delta[n].value, math.hypot(q.std, delta[n].std), q.unit)
        for n, q in own.items()
        if n in delta
    }
    linear = [each.name for each in finding.effect.parameters(less) if each.linear and each.name in total]
    gone = all(abs(total[n].value) < max(3.0 * total[n].std, _REST * abs(own[n].value)) for n in linear)
    if linear and gone:
        return Change(finding, sign, "a" if side == "b" else "b", own if side == "b" else {})
    return Change(finding, sign, "both", own if side == "b" else total)


def _uncompared(a: RecordedMotion, b: RecordedMotion) -> list[str]:
    """What only one of the recordings has, one sentence each."""
    notes = []
    if a.has("wrench") != b.has("wrench"):
        notes.append(f"only {'A' if a.has('wrench') else 'B'} has a wrench: it is not compared")
    efforts = [set() if each.effort is None else set(each.effort.names) for each in (a, b)]
    if alone := sorted(efforts[0] ^ efforts[1]):
        notes.append(f"only one recording has usable efforts of {', '.join(alone)}: they are not compared")
    return notes


def _equal(change: Change, a: RecordedMotion, b: RecordedMotion, stages: _Stages) -> bool:
    """Whether each recording by itself shows the same of an effect: then it acts on the other changes, too."""
    name = change.finding.effect.name
    alone = [[f for f in stages.alone(each, stages.model).findings if f.effect.name == name] for each in (a, b)]
    if not all(alone):
        return False
    one, other = (found[0].parameters for found in alone)
    return all(
        abs(other[n].value - q.value) < max(3.0 * math.hypot(q.std, other[n].std), _REST * abs(q.value))
        for n, q in one.items()
    )


def _notes(matched: Alignment, skew: float) -> tuple[str, ...]:
    notes = [f"{matched.share:.0%} of B's motion is also in A; it is compared at the same postures"]
    if abs(matched.rate - 1.0) < _SKEW < abs(skew - 1.0):
        fast = "slow" if skew > 1.0 else "fast"
        notes.append(f"B's clock runs {abs(skew - 1.0):.1%} {fast} against A's: its readings are taken at A's times")
    if not _same_speed(matched):
        notes.append(f"B moves {matched.rate:.2f} times as fast as A: what A lacks is diagnosed first")
    return tuple(notes)
