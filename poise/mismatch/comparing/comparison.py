"""What changed between two recordings of one robot."""

import math
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.answer import Diagnosis, Quantity, Verdict, verdict_of
from poise.mismatch.comparing.alignment import Alignment, align, postures
from poise.mismatch.comparing.change import Change, Recorded, alike, as_much, beyond_errors, change_of
from poise.mismatch.comparing.difference import difference, with_motion_of
from poise.mismatch.comparing.direction import has_less, unexplained
from poise.mismatch.comparing.known_load import with_known_load
from poise.mismatch.comparing.stages import Stages
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
_EQUAL_NOTE = "each recording by itself shows the same {}: it acts on what changed, and is no change"
_REST_NOTE = "no effect explains all that the model lacks in {}: a change of the rest may be hidden there"
_HIDDEN_NOTE = "{} is also among what no effect explains there, and as large: it is no change"
_SMALL_NOTE = "{} differs by no more than the errors of both answers, and is no change"


_Ways = dict[Recorded, tuple[RecordedMotion, RecordedMotion, Alignment]]
"""By the recording that is described: that one, the other one, and the alignment of it with the other one."""


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
    side: Recorded
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
    of what both have. Where the speeds or the motions differ, what the other recording lacks is diagnosed first, and
    becomes part of the model.

    Args:
        a, b: of one robot, predicted with one model.
        model: of both.
        deadline: s after which the search ends with its best answer so far.
        progress: is called with the completed share, 0 to 1.

    Raises:
        InputError: BAD_INPUT when both are one recording; see `align` and `difference`.
        NoAnswerError: see `diagnose`.
    """
    begin = time.perf_counter()
    _check_apart(a, b)
    uncompared = _uncompared(a, b)
    a, b = with_common_efforts([a, b])
    stages = Stages(model, deadline, progress)
    matched = align(b, a)
    if not same_path(matched):
        return _through_model(a, b, matched, stages, uncompared, begin)
    skew = matched.rate if _SKEW < abs(matched.rate - 1.0) < _ALIKE else 1.0
    b, matched = (b, matched) if skew == 1.0 else _with_clock(a, b, matched)
    ways: _Ways = {"b": (b, a, matched), "a": (a, b, matched.reversed())}
    side, found = _likelier(ways, stages)
    changes, equal = _changes(found, side, a, b, stages, same_speed(matched))
    imitated = {each.finding.effect.name for each in equal if each.finding.effect.layer == "friction"}
    if imitated:  # it acts by itself, so that it cannot differ where both have the same: it stands for something else
        found = _one_way(*ways[side], stages, imitated)
        changes, equal = _changes(found, side, a, b, stages, same_speed(matched))
    notes = [*uncompared, *_notes(matched, skew), *(_EQUAL_NOTE.format(each.finding.effect.name) for each in equal)]
    kept = tuple(each for each in changes if each not in equal)
    if not same_speed(matched):
        less = a if side == "b" else b
        kept, said = _material(kept, stages.alone(less, stages.for_two), less, side, stages)
        notes += said
    progress(1.0)
    return Comparison(found, kept, side, matched, tuple(notes), time.perf_counter() - begin)


def _with_clock(a: RecordedMotion, b: RecordedMotion, matched: Alignment) -> tuple[RecordedMotion, Alignment]:
    """B as if its clock and not its speed differed, where that leaves less."""
    on_a = with_motion_of(b, a, matched.reversed())
    instead = align(on_a, a)
    better = unexplained(without_common(on_a, a, instead)) < unexplained(without_common(b, a, matched))
    return (on_a, instead) if better else (b, matched)


def _changes(
    found: Diagnosis, side: Recorded, a: RecordedMotion, b: RecordedMotion, stages: Stages, same: bool
) -> tuple[list[Change], list[Change]]:
    """The changes that an answer names, and those of them that each recording by itself shows alike."""
    less = a if side == "b" else b
    if same:
        owned = [stages.own_values(each, less) for each in found.findings]
    else:  # as the model has it
        known = _values(stages.alone(less, stages.for_two))
        owned = [known.get(each.effect.name, {}) for each in found.findings]
    changes = [change_of(each, side, own, less) for each, own in zip(found.findings, owned, strict=True)]
    equal = [
        each
        for each in changes
        if len(changes) > 1
        and each.present_in == "both"
        and not each.finding.effect.of_joint  # friction of a joint acts by itself
        and alike(*(stages.own_values(each.finding, one) for one in (a, b)))
    ]
    return changes, equal


def _material(
    changes: Sequence[Change], alone: Diagnosis, less: RecordedMotion, side: Recorded, stages: Stages
) -> tuple[tuple[Change, ...], list[str]]:
    """The changes that the other recording does not have, and notes on those that are none.

    Args:
        changes: of an answer.
        alone: what the model lacks in the other recording, which became part of the model: its values have errors, and
            what no effect explains there may be an effect of the answer. (One fit to that recording alone is unsure of
            what friction of another law leaves.)
        less: the other recording. side: the one that has more.
        stages: for such a fit.
    """
    own, kept = _values(alone), list[Change]()
    notes = [_REST_NOTE.format("A" if side == "b" else "B")] * (alone.unknown is not None)
    for each in changes:
        name = each.finding.effect.name
        hidden = alone.unknown is not None and name not in own
        shown = stages.own_values(each.finding, less) if hidden else {}
        if shown and as_much(shown, each.finding.parameters):
            notes.append(_HIDDEN_NOTE.format(name))
        elif beyond_errors(each, own.get(name, {}), less):
            kept.append(each)
        else:
            notes.append(_SMALL_NOTE.format(name))
    return tuple(kept), notes


def _values(found: Diagnosis) -> dict[str, dict[str, Quantity]]:
    """The parameters of each effect that was found."""
    return {each.effect.name: each.parameters for each in found.findings}


def _check_apart(a: RecordedMotion, b: RecordedMotion) -> None:
    signals = [(a.wrench, b.wrench)] if a.has("wrench") else []
    if a.effort is not None and b.effort is not None:
        signals.append((a.effort.measured, b.effort.measured))
    if signals and all(one.shape == other.shape and np.array_equal(one, other) for one, other in signals):
        raise InputError(ErrorCode.BAD_INPUT, "compare: both recordings hold the same readings: give two recordings")


def same_path(matched: Alignment) -> bool:
    near = (matched.distance < _NEAR)[matched.moving]
    seconds = len(near) * float(np.median(np.diff(matched.seconds))) if len(near) else 0.0
    return seconds >= _LEAST and matched.share * near.mean() >= _SHARED


def _through_model(
    a: RecordedMotion, b: RecordedMotion, matched: Alignment, stages: Stages, notes: list[str], begin: float
) -> Comparison:
    """Two motions: what A lacks becomes part of the model, and B is held against that.

    What no effect explains in A may be what changed: A is then held against B, if B leaves nothing unexplained.
    """
    side: Recorded = "b"
    this, less, model = b, a, stages.model
    # A whole search in A is the last resort.
    if stages.usual(a, model).unknown is not None and (
        stages.usual(b, model).unknown is None
        or (stages.alone(a, model).unknown is not None and stages.alone(b, model).unknown is None)
    ):
        side, this, less = "a", a, b
    alone = stages.alone(less, model)
    found = stages.diagnose(with_known_load(this, alone), alone.augmented)
    own = _values(alone)
    changes = [change_of(each, side, own.get(each.effect.name, {}), less) for each in found.findings]
    kept, said = _material(changes, alone, less, side, stages)
    share = f"{matched.share:.0%} of B's motion is also in A"
    lacking = "A" if side == "b" else "B"
    said = [f"{share}: both are compared through the model, with what {lacking} lacks", *said]
    return Comparison(found, kept, side, matched, (*notes, *said), time.perf_counter() - begin)


def same_speed(matched: Alignment) -> bool:
    return abs(matched.rate - 1.0) < _ALIKE


def _likelier(ways: _Ways, stages: Stages) -> tuple[Recorded, Diagnosis]:
    """The side that has more, and what it has: the likely side first, the other one where that leaves something."""
    first: Recorded = "a" if has_less(without_common(*ways["b"])) else "b"
    other: Recorded = "b" if first == "a" else "a"
    found = _one_way(*ways[first], stages)
    if found.verdict in ("none", "named") or (found.findings and not _unexplained(found)):
        return first, found
    instead = _one_way(*ways[other], stages)
    return (other, instead) if _better(instead, found) else (first, found)


def _unexplained(found: Diagnosis) -> bool:
    """Whether a residual is left; effects that no name is sure of explain theirs."""
    return any(each.residual_test.structured for each in found.examinations)


def _one_way(
    this: RecordedMotion, other: RecordedMotion, matched: Alignment, stages: Stages, without: Collection[str] = ()
) -> Diagnosis:
    """What this recording has and the other lacks; `without`: effects that are not tried."""
    if same_speed(matched):
        return stages.diagnose(without_common(this, other, matched), stages.for_two, without=without)
    alone = stages.alone(other, stages.for_two)
    less = without_common(this, with_model_effects(other, alone.augmented.effects), matched)
    return stages.diagnose(with_known_load(less, alone), alone.augmented, without=without)


def without_common(this: RecordedMotion, other: RecordedMotion, matched: Alignment) -> RecordedMotion:
    """This recording without what the other has too, where both move alike."""
    slip, same = math.inf, same_speed(matched)
    if same:
        _, seconds, places = postures(this)
        slip = _SLIP * float(np.sqrt(np.mean((np.gradient(places, seconds, axis=0) ** 2).sum(axis=1))))
    return difference(this, other, matched, matched.alike(_NEAR, slip, _MARGIN), same)


def _better(one: Diagnosis, usual: Diagnosis) -> bool:
    """Whether an answer has clearly more evidence: what has one sign is imitated badly the other way around."""
    return _evidence(one) > _CLEARLY * _evidence(usual)


def _evidence(found: Diagnosis) -> float:
    """Nats of the named effects, per sample: the faster recording has fewer."""
    nats = sum(each.belief.basis.evidence for each in found.findings if each.belief.basis is not None)
    return nats / sum(len(each.problem.seconds) for each in found.examinations)


def _uncompared(a: RecordedMotion, b: RecordedMotion) -> list[str]:
    """What only one of the recordings has, one sentence each."""
    notes = []
    if a.has("wrench") != b.has("wrench"):
        notes.append(f"only {'A' if a.has('wrench') else 'B'} has a wrench: it is not compared")
    efforts = [set() if each.effort is None else set(each.effort.names) for each in (a, b)]
    if alone := sorted(efforts[0] ^ efforts[1]):
        notes.append(f"only one recording has usable efforts of {', '.join(alone)}: they are not compared")
    return notes


def _notes(matched: Alignment, skew: float) -> tuple[str, ...]:
    notes = [f"{matched.share:.0%} of B's motion is also in A; it is compared at the same postures"]
    if abs(matched.rate - 1.0) < _SKEW < abs(skew - 1.0):
        fast = "slow" if skew > 1.0 else "fast"
        notes.append(f"B's clock runs {abs(skew - 1.0):.1%} {fast} against A's: its readings are taken at A's times")
    if not same_speed(matched):
        notes.append(f"B moves {matched.rate:.2f} times as fast as A: what A lacks is diagnosed first")
    return tuple(notes)
